"""Wrong materials and temperatures: rows of the table of wrong_inputs.py."""

from wrong_input import Wrong, run

PLY = ("material.young=[1.3e11, 1.1e10, 9e9]", "material.poisson=[0.28, 0.3, 0.4]")
SHEAR = "material.shear=[5e9, 4.5e9, 3.5e9]"
HEATED = ("material.expansion=1.2e-5", "temperature.reference=20.0")

MATERIALS = (
    Wrong(
        "three Young's moduli without shear moduli",
        run(*PLY),
        r"material = .*: an orthotropic material has three numbers each in young .* but not in shear; an isotropic one",
    ),
    Wrong(
        "one Young's modulus with shear moduli",
        run(SHEAR),
        r"material = .*: an orthotropic material has three numbers each in .* but not in young, poisson; an isotropic",
    ),
    Wrong(
        "two Young's moduli",
        run("material.young=[1e9, 2e9]"),
        r"material\.young = \[1000000000\.0, 2000000000\.0\]: should be a number or a list of 3 numbers",
    ),
    Wrong(
        "Poisson's ratios with a negative strain energy",
        run(*PLY, SHEAR, "material.poisson=[0.28, 0.3, 1.3]"),
        r"material = .*: poisson: nu23 = 1\.3 gives a negative strain energy: \|nu23\| must be below sqrt\(E2/E3\) = 1",
    ),
    Wrong(
        "parallel directions",
        run(*PLY, SHEAR, "material.directions=[[1, 0, 1], [2, 0, 2]]"),
        r"material = .*: directions: the two directions must not be parallel",
    ),
    Wrong(
        "directions without a value in a cell",
        run(*PLY, SHEAR, "material.directions=[['-y', 'x', 0], ['y', '0 - x', 0]]"),
        r"material: directions: the two directions must not be parallel, but are at x = 0\.5, 0\.5, 0\.5",
    ),
    Wrong(
        "directions of an isotropic material",
        run("material.directions=[[1, 0, 0], [0, 1, 0]]"),
        r"material = .*: directions are for an orthotropic material, which has three numbers in young",
    ),
    Wrong(
        "a temperature without thermal expansion",
        run("temperature.value=80.0"),
        r"a temperature needs the thermal expansion of every material, but the material has none: expansion, 1/K",
    ),
    Wrong(
        "a temperature without a value",
        run(*HEATED),
        r"temperature = .*: give either value, or file and field, one of the two",
    ),
    Wrong(
        "a file of temperatures without the name of a field",
        run(*HEATED, "temperature.file='heat.vtu'"),
        r"temperature = .*: file and field go together: the file, and the name of the temperatures in it",
    ),
    Wrong(
        "a file of temperatures that does not exist",
        run(*HEATED, "temperature.file='heat.vtu'", "temperature.field='T'"),
        r"heat\.vtu: cannot be read: No such file or directory",
    ),
    Wrong(
        "an amplitude of the temperature without a history",
        run(*HEATED, "temperature.value=80.0", "temperature.amplitude=[[0, 0], [1, 1]]"),
        r"temperature\.amplitude depends on time: it needs a \[history\]",
    ),
)
