"""Wrong case files: rows of the table of wrong_inputs.py."""

import os

import numpy as np
from wrong_input import BLOCK, Wrong, case, part, run

CASE_FILES = (
    Wrong(
        "a case that does not exist", run(case="none.toml"), r"none\.toml: cannot be read: No such file or directory"
    ),
    Wrong("a directory in place of the case", run(case="."), r"\.: cannot be read: Is a directory"),
    Wrong(
        "a case cut short",
        run(),
        r"case\.toml: is not TOML: .*table declaration",
        case("[mesh"),
        library="is not TOML: ",
    ),
    Wrong(
        "a case that is no text",
        run(),
        r"case\.toml: cannot be read: it is not UTF-8 text: ",
        case(b"\xfc\xff"),
        library="UTF-8: ",
    ),
    Wrong(
        "a case in UTF-16",
        run(),
        r"case\.toml: cannot be read: it is text in UTF-16; save it as UTF-8",
        case(BLOCK.encode("utf-16")),
    ),
    Wrong(
        "a pipe for a case",
        run(case="pipe"),
        r"pipe: cannot be read: it is a pipe: save the contents in a file first",
        lambda: os.mkfifo("pipe"),
    ),
    Wrong(
        "single brackets",
        run(),
        r"clamp: there may be several: write \[\[clamp\]\], with double brackets, in place of \[clamp\]",
        case(BLOCK.replace("[[clamp]]", "[clamp]")),
    ),
    Wrong(
        "a value for a table",
        run(),
        r"mesh = 'part\.msh': is a table: write \[mesh\], and below it its keys, for example file = 'part\.msh'",
        case('mesh = "part.msh"\n' + BLOCK[BLOCK.index("[material]") :]),
    ),
    Wrong(
        "a key below a table that belongs above all",
        run(),
        r"output\.body_force = .*; it belongs at the top of the file, above the first table",
        case(BLOCK + "body_force = [0, 0, 1]\n"),
    ),
    Wrong(
        "lists in lists without end",
        run(),
        r"case\.toml: is not a case: lists or tables are nested too deeply",
        case(BLOCK + "a = " + 10_000 * "["),
    ),
    Wrong(
        "a name of 300 characters",
        run(f"contact.face='{'x' * 300}'"),
        r"contact\.face = 'x+\.\.\.x+': should have at most 200 characters",
    ),
    Wrong("an empty case", run(), r"mesh: is missing\n.*material: is missing\n.*contact: is missing", case("")),
    Wrong(
        "a misspelt key", run("contact.fricton=0.3"), r"contact\.fricton = 0\.3: there is no such key; did you mean fri"
    ),
    Wrong("a misspelt table", run("clmap=[]"), r"clmap = \[\]: there is no such key; did you mean clamp\?"),
    Wrong(
        "words for a number",
        run("contact.friction='rough'"),
        r"contact\.friction = 'rough': 'rough' is not known in an expression",
    ),
    Wrong(
        "true for a number",
        run("material.young=true"),
        r"material\.young = true: should be a number or a list of 3 numbers",
    ),
    Wrong(
        "large strains to be ignored",
        run("small_strain='ignore'"),
        r"small_strain = 'ignore': should be 'enforce' or 'warn'",
    ),
    Wrong(
        "two numbers for three", run("traction.0.value=[0,1]"), r"traction\.0\.value = \[0, 1\]: should be a list of 3"
    ),
    Wrong(
        "--set without a value", run("friction"), r"--set friction: must be key\.key=value, for example mesh\.cells="
    ),
    Wrong(
        "--set in a table that is not there",
        run("traction.7.face='top'"),
        r"no such place in the case; lists are numbered from 0",
    ),
    Wrong("an unknown method", run("solver.linear_solver='lu'"), r"'lu': should be 'auto', 'direct' or 'iterative'"),
    Wrong(
        "too loose a tolerance",
        run("solver.tolerance=1e-3"),
        r"solver\.tolerance = 0\.001: should be less than or equal",
    ),
    Wrong(
        "A to be formed, K not to be factorised",
        run("solver={linear_solver='iterative', compliance='explicit'}"),
        r'A can be formed \(solver\.compliance = "explicit".*set solver\.linear_solver = "direct"',
    ),
    Wrong(
        "dense Newton systems on two ranks",
        run("solver.newton='dense'"),
        r'solver\.newton = "dense" works on one rank',
        alone=None,
    ),
    Wrong(
        "condensed Newton systems of a body that contact alone holds",
        run("clamp=[]", "solver.newton='condensed'"),
        r'solver\.newton = "condensed" needs bodies that supports hold',
    ),
)

MATERIALS_AND_LOADS = (
    Wrong("Poisson's ratio 0.5", run("material.poisson=0.5"), r"material\.poisson = 0\.5: should be less than 0\.5"),
    Wrong(
        "Poisson's ratio 0.4999999",
        ("check-case", "case.toml", "--set", "material.poisson=0.4999999"),
        r"warning: material: poisson = 0\.4999999 is near 0\.5: above 0\.49 first-order elements lock",
        code=0,
    ),
    Wrong("no stiffness", run("material.young=0"), r"material\.young = 0: should be greater than 0"),
    Wrong(
        "negative friction", run("contact.friction=-0.3"), r"contact\.friction = -0\.3: should be greater than or equal"
    ),
    Wrong(
        "friction by slip rate without its speed",
        run("contact.friction={static=0.3, kinetic=0.2}"),
        r"contact\.friction\.decay_speed: is missing",
    ),
    Wrong(
        "a decay speed of zero",
        run("contact.friction={static=0.3, kinetic=0.2, decay_speed=0}"),
        r"contact\.friction\.decay_speed = 0: should be greater than 0",
    ),
    Wrong(
        "a misspelt key of friction by slip rate",
        run("contact.friction={static=0.3, dynamic=0.2, decay_speed=0.1}"),
        r"contact\.friction\.kinetic: is missing\n.*contact\.friction\.dynamic = 0\.2: there is no such key",
    ),
    Wrong(
        "two tables of friction by slip rate",
        run(
            "contact.friction=[{static=0.3, kinetic=0.2, decay_speed=0.1}, {static=0.1, kinetic=0.1, decay_speed=0.1}]"
        ),
        r"contact\.friction = .*: should be two numbers: friction by slip rate is the same in all directions",
    ),
    Wrong(
        "two coefficients in friction by slip rate",
        run("contact.friction={static=[0.3, 0.1], kinetic=0.2, decay_speed=0.1}"),
        r"contact\.friction\.static = \[0\.3, 0\.1\]: should be one number: friction by slip rate is the same",
    ),
    Wrong(
        "friction by slip rate with a direction",
        run("contact.friction={static=0.3, kinetic=0.2, decay_speed=0.1}", "contact.direction=[1,0,0]"),
        r"friction by slip rate is the same in all directions: give neither a direction nor two coefficients",
    ),
    Wrong(
        "friction that becomes negative",
        run("contact.friction_amplitude=[[0,1],[1,-1]]"),
        r"friction_amplitude: factors must be >= 0",
    ),
    Wrong(
        "both friction laws",
        run("contact.slip_stress=1e6"),
        r"give either friction \(Coulomb\) or slip_stress \(Tresca\)",
    ),
    Wrong(
        "a load of NaN", run("traction.0.value=[0,0,nan]"), r"traction\.0\.value\.2 = nan: should be a finite number"
    ),
    Wrong(
        "an infinite displacement",
        run("clamp.0.value=[inf,0,0]"),
        r"clamp\.0\.value\.0 = inf: should be a finite number",
    ),
    Wrong(
        "a spring of no stiffness",
        run("spring=[{face='top', stiffness=0}]"),
        r"spring on 'top': stiffness .* not all 0",
    ),
    Wrong(
        "springs too soft in comparison with rounding errors",
        run("clamp=[]", "spring=[{face='top', stiffness=1e-6}]"),
        r"the springs are too soft .* make the springs stiffer, or leave them out where contact holds the body",
    ),
    Wrong(
        "an amplitude whose times do not increase",
        run("history={times=[1]}", "clamp.0.amplitude=[[0,0],[1,1],[1,2]]"),
        r"prescribed displacement on 'left'.*: the times of the table must increase, but are \[0\.0, 1\.0, 1\.0\]",
    ),
    Wrong(
        "an amplitude without a history",
        run("traction.0.amplitude=[[0,0],[1,1]]"),
        r"depends on time: it needs a \[history\]",
    ),
    Wrong(
        "a foundation that moves without a history",
        run("contact.motion=[[0,0,0,0],[1,0,0,1e-3]]"),
        r"contact\.motion depends on time: it needs a \[history\]",
    ),
    Wrong(
        "a foundation that rotates without a history",
        run("contact.rotation={point=[0,0,0], axis=[0,1,0], angle=[[0,0],[1,1]]}"),
        r"contact\.rotation depends on time: it needs a \[history\]",
    ),
    Wrong(
        "a foundation that rotates about no axis",
        run("history={times=[1]}", "contact.rotation={point=[0,0,0], axis=[0,0,0], angle=[[0,0],[1,1]]}"),
        r"contact\.rotation\.axis = \[0, 0, 0\]: must not be zero",
    ),
    Wrong(
        "a rotation whose times do not increase",
        run("history={times=[1]}", "contact.rotation={point=[0,0,0], axis=[0,1,0], angle=[[0,0],[1,1],[1,2]]}"),
        r"contact: foundation: rotation: angle: the times of the table must increase, but are \[0\.0, 1\.0, 1\.0\]",
    ),
    Wrong(
        "a foundation that rotates through the body",
        (
            *("check-case", "case.toml", "--set", "history={times=[1, 2]}"),
            *("--set", "contact.rotation={point=[0,0,0], axis=[0,1,0], angle=[[1,0], [2,2]]}"),
        ),
        r"contact face 'bottom' is turned away from the foundation",
    ),
    Wrong(
        "a thousand million load steps",
        run("history={end=1.0, steps=1000000000}"),
        r"history\.steps = 1000000000: should be less than or equal to 100000",
    ),
    Wrong(
        "friction that is next to nothing",
        run("contact.friction=1e-300"),
        r"contact\.friction = 1e-300: should be 0, or from 1e-09 to 1000 in size",
    ),
    Wrong("a history without times", run("history={halvings=3}"), r"give either times, .*, or end and steps"),
    Wrong(
        "a history that goes back",
        run("history={times=[1,0.5]}"),
        r"times must increase from start = 0, but are \[1\.0, 0\.5\]",
    ),
)

CONTACT = (
    Wrong(
        "a contact face that is fully clamped",
        run("contact.face='left'"),
        r"'left' is fully clamped: none of its nodes",
    ),
    Wrong(
        "a foundation turned away",
        run("contact.foundation={point=[0,0,0], normal=[0,0,-1]}"),
        r"contact face 'bottom' is turned away from the foundation: reverse the normal",
    ),
    Wrong(
        "a foundation that moves to the other side",
        (
            *("check-case", "case.toml", "--set", "history={times=[1, 2]}"),
            *("--set", "contact.foundation={shape='sphere', centre=[1.5,0.5,-9], radius=9}"),
            *("--set", "contact.motion=[[1,0,0,0], [2,0,0,20]]"),
        ),
        r"contact face 'bottom' is turned away from the foundation",
    ),
    Wrong(
        "a plane without a direction",
        run("contact.foundation={point=[0,0,0], normal=[0,0,0]}"),
        r"contact\.foundation = .*: plane: normal must not be zero",
    ),
    Wrong(
        "a sphere of radius 0",
        run("contact.foundation={shape='sphere', centre=[0,0,-1], radius=0}"),
        r"contact\.foundation\.radius = 0: should be greater than 0",
    ),
    Wrong(
        "a sphere without a centre",
        run("contact.foundation={shape='sphere', radius=1}"),
        r'a foundation of shape "sphere" needs centre',
    ),
    Wrong(
        "a region without nodes",
        run("contact.region=[{box=[[5,5,5],[6,6,6]], friction=0.1}]"),
        r"contact\.region\.0: there is no contact node in its box",
    ),
    Wrong(
        "a region whose corners are exchanged",
        run("contact.region=[{box=[[1,1,1],[0,0,0]], friction=0.1}]"),
        r"box must be \[lower corner, upper corner\]",
    ),
    Wrong(
        "a negative cohesion",
        run("contact.cohesion=-1e6"),
        r"contact\.cohesion = -1000000\.0: should be greater than or equal to 0",
    ),
    Wrong(
        "cohesion beside slip_stress",
        run("contact={face='bottom', slip_stress=1e6, cohesion=1e6}"),
        r"cohesion goes with friction; slip_stress is a cohesion alone",
    ),
    Wrong(
        "a region with cohesion where the face has none",
        run("contact.region=[{box=[[0,0,0],[1,1,1]], cohesion=1e6}]"),
        r"region\.0 must give friction, as the contact does, and nothing else but its box",
    ),
    Wrong(
        "two coefficients of friction without a direction",
        run("contact.friction=[0.3, 0.1]"),
        r"two coefficients, friction = \[along, across\], need a direction",
    ),
    Wrong(
        "three coefficients of friction",
        run("contact.friction=[0.3, 0.2, 0.1]", "contact.direction=[1,0,0]"),
        r"contact\.friction = \[0\.3, 0\.2, 0\.1\]: should have at most 2 items",
    ),
    Wrong(
        "friction in one direction only",
        run("contact.friction=[0.3, 0]", "contact.direction=[1,0,0]"),
        r"friction \(0\.3, 0\) at x = .*: the smaller coefficient must be at least 0\.001 of the larger, or both 0",
    ),
    Wrong(
        "a direction of friction along the normal",
        run("contact.friction=[0.3, 0.1]", "contact.direction=[0,0,1]"),
        r"contact face 'bottom': the direction of friction is along the normal at x = .*; it must lie in the face",
    ),
    Wrong(
        "a curved contact face without a foundation",
        run("contact.face='both'"),
        r"contact face 'both' is not plane: give its foundation",
        part(lambda file: file.faces.update(both=np.vstack([file.faces["bottom"], file.faces["right"]]))),
    ),
)
