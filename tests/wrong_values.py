"""Values of another type than the key's: rows of the table of wrong_inputs.py."""

from wrong_input import Wrong, run

VALUES = (
    Wrong(
        "text for a list of numbers",
        run("history.times='1,2'"),
        r"history\.times = '1,2': should be a list of numbers, as \[1\.0, 2\.0\], not text",
    ),
    Wrong(
        "a number for a list of numbers",
        run("history.times=2.0"),
        r"history\.times = 2\.0: should be a list of numbers, as \[1\.0, 2\.0\]",
    ),
    Wrong(
        "lists in a list of numbers",
        run("history.times=[[1,2]]"),
        r"history\.times\.0 = \[1, 2\]: should be a number",
    ),
    Wrong(
        "one number for three",
        run("mesh.box=1.0"),
        r"mesh\.box = 1\.0: should be a list of 3 numbers, as \[1\.0, 2\.0, 3\.0\]",
    ),
    Wrong(
        "an empty list for three numbers",
        run("mesh.cells=[]"),
        r"mesh\.cells = \[\]: should be a list of 3 whole numbers, as \[1, 2, 3\]",
    ),
    Wrong(
        "a number with a fraction for a whole number",
        run("mesh.cells=[3.5,1,1]"),
        r"mesh\.cells\.0 = 3\.5: should be a whole number",
    ),
    Wrong(
        "text for a number",
        run("mesh.box=['3',1,1]"),
        r"mesh\.box\.0 = '3': should be a number, not text",
    ),
    Wrong(
        "true for a component of a vector",
        run("traction.0.value=[true,0,0]"),
        r"traction\.0\.value\.0 = true: should be a number or an expression in quotation marks",
    ),
    Wrong(
        "a table for a vector",
        run("traction.0.value={x=1.0}"),
        r"traction\.0\.value = \{'x': 1\.0\}: should be a list of 3 numbers or expressions in quotation marks, as \[",
    ),
    Wrong(
        "one row in place of rows",
        run("traction.0.amplitude=[0,1]"),
        r"amplitude\.0 = 0: should be a row \[time, factor\]\n.*amplitude\.1 = 1: should be a row \[time, factor\]$",
    ),
    Wrong(
        "a number for a table in time",
        run("contact.motion=1e-3"),
        r"contact\.motion = 0\.001: should be a list of rows \[time, x, y, z\]",
    ),
    Wrong(
        "rows that are too short",
        run("contact.motion=[[0,0,0],[1,0,0]]"),
        r"motion\.0 = \[0, 0, 0\]: should be a row \[time, x, y, z\]\n.*motion\.1 = .*row \[time, x, y, z\]$",
    ),
    Wrong(
        "an angle in place of the rows of a load curve",
        run("contact.rotation={point=[0,0,0], axis=[0,0,1], angle={table=0.1}}"),
        r"contact\.rotation\.angle\.table = 0\.1: should be a list of rows \[time, angle\]",
    ),
    Wrong(
        "a vector for directions of a material",
        run("material.directions=[1,0]"),
        r"material\.directions\.0 = 1: should be a list of 3 numbers or expressions in quotation marks",
    ),
    Wrong(
        "text for a list of tables",
        run("traction='1,2'"),
        r"traction = '1,2': is a list of tables: write \[\[traction\]\], and below it its keys",
    ),
    Wrong("a number for text", run("contact.face=3"), r"contact\.face = 3: should be text in quotation marks"),
    Wrong(
        "a number for true or false",
        run("output.picture=7"),
        r"output\.picture = 7: should be true or false",
    ),
    Wrong(
        "a list for one number",
        run("contact.foundation={shape='sphere', centre=[0,0,0], radius=[1.0]}"),
        r"contact\.foundation\.radius = \[1\.0\]: should be a number$",
    ),
    Wrong(
        "a tolerance of 0",
        run("solver.tolerance=0"),
        r"solver\.tolerance = 0: should be greater than or equal to 1e-12$",
    ),
    Wrong(
        "lengths in two units",
        run("mesh.box=[3e6,1e-6,1]"),
        r"the body is 3e\+06 m long and 1e-06 m thin: .* that it spins about x .* check the lengths and the unit",
    ),
    Wrong(
        "a thickness in another unit",
        run("mesh.box=[3.0,1.0,1e-9]"),
        r"there are cells 1\.0e\+09 times as long as they are thick; check the lengths and the unit",
    ),
)
