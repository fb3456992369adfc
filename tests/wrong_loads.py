"""Wrong loads, expressions of place and load curves: rows of the table of wrong_inputs.py."""

from wrong_input import Wrong, case, run

STEPPED = "history={times=[1, 2]}"


def curve(value):
    return run(STEPPED, f"traction.0.amplitude={value}")


LOADS = (
    Wrong(
        "a name in an expression that is not known",
        run('traction.0.value=[0, 0, "-1e6*(1 + r/2)"]'),
        r"traction\.0\.value\.2 = '-1e6\*\(1 \+ r/2\)': 'r' is not known in an expression; allowed are numbers, x",
    ),
    Wrong(
        "a power as in other languages",
        run('traction.0.value=[0, 0, "-1e6*x^2"]'),
        r"traction\.0\.value\.2 = .*: '-1e6\*x\^2': a power is written \*\*",
    ),
    Wrong(
        "time in an expression of place",
        run('body_force=["1e3*t", 0, 0]'),
        r"body_force\.0 = '1e3\*t': 't' is not known in an expression of place \(time is a matter of the amplitude\)",
    ),
    Wrong(
        "code in place of an expression",
        run("contact.friction=\"__import__('os').getpid()\""),
        r"contact\.friction = .*: .* is not allowed in an expression",
    ),
    Wrong(
        "an expression without a value at a node",
        run('traction.0.value=[0, 0, "sqrt(x - 1)"]'),
        r"traction on 'top': the expression 'sqrt\(x - 1\)' is nan at \(0, 0, 1\)",
    ),
    Wrong(
        "an expression of negative friction",
        run('contact.friction="0.5 - x"'),
        r"contact face 'bottom': friction: must be >= 0 everywhere, but is -0\.5 at x = 1, 0, 0",
    ),
    Wrong(
        "a pressure on a face that is not there",
        run("pressure=[{face='lid', value=1e6}]"),
        r"pressure\.0\.face = 'lid': should be 'left'",
    ),
    Wrong(
        "a pressure with a direction",
        run("pressure=[{face='top', value=[0, 0, -1e6]}]"),
        r"pressure\.0\.value = \[0, 0, -1000000\.0\]: should be a number or an expression in quotation marks",
    ),
    Wrong(
        "a total force of one number",
        run("total_force=[{face='top', force=5.0}]"),
        r"total_force\.0\.force = 5\.0: should be a list of 3 numbers, as \[1\.0, 2\.0, 3\.0\]",
    ),
    Wrong(
        "gravity without a density",
        run("gravity=[0, 0, -9.81]"),
        r"gravity needs the density of every material, but the material has none: density, kg/m\^3",
    ),
    Wrong(
        "a density of zero",
        run("material.density=0", "gravity=[0, 0, -9.81]"),
        r"material\.density = 0: should be greater than 0",
    ),
    Wrong(
        "gravity in time without a history",
        run("material.density=7850.0", "gravity=[0,0,-9.81]", "gravity_amplitude=[[0,0],[1,1]]"),
        r"gravity_amplitude depends on time: it needs a \[history\]",
    ),
    Wrong(
        "the name of a CSV file without a table",
        curve("'curve.csv'"),
        r"traction\.0\.amplitude = 'curve\.csv': should be a table of rows, or \{ file = \"curve\.csv\" \}",
    ),
    Wrong(
        "a CSV file that does not exist",
        curve("{file='curve.csv'}"),
        r"traction\.0\.amplitude: curve\.csv: cannot be read: No such file or directory",
    ),
    Wrong(
        "words in a CSV file",
        curve("{file='curve.csv'}"),
        r"traction\.0\.amplitude: curve\.csv, line 3: '1, full' is no row of numbers",
        case("time, factor\n0, 0\n1, full\n", "curve.csv"),
    ),
    Wrong(
        "decimal commas in a CSV file",
        curve("{file='curve.csv'}"),
        r"curve\.csv, line 2: '0,0;0,5' should be 2 finite numbers, time, factor; a decimal sign must be a point",
        case("time;factor\n0,0;0,5\n", "curve.csv"),
    ),
    Wrong(
        "two columns for a motion",
        run(STEPPED, "contact.motion={file='curve.csv'}"),
        r"contact\.motion: curve\.csv, line 1: '0, 0' should be 4 finite numbers, time, x, y, z",
        case("0, 0\n1, 1\n", "curve.csv"),
    ),
    Wrong(
        "a table and a file for one curve",
        curve("{table=[[0,0],[2,1]], file='curve.csv'}"),
        r"traction\.0\.amplitude: give either table or file, one of the two",
    ),
    Wrong(
        "a repeated curve with a jump",
        curve("{table=[[0,0],[1,1]], after='repeat'}"),
        r"traction\.0\.amplitude = .*: load curve: a repeated curve must end with the value with which it begins",
    ),
    Wrong(
        "a curve that ends before the history",
        curve("{table=[[0,0],[1,1]], after='error'}"),
        r"traction\.0\.amplitude: the load curve ends at time 1, but its value at time 2 is needed",
    ),
    Wrong(
        "something else after a curve",
        curve("{table=[[0,0],[1,1]], after='zero'}"),
        r"traction\.0\.amplitude\.after = 'zero': should be 'hold', 'error' or 'repeat'",
    ),
)
