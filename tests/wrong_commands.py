"""Wrong commands: rows of the table of wrong_inputs.py."""

from pathlib import Path

from wrong_input import (
    STEPS,
    Wrong,
    another_run,
    case,
    cut,
    edit_written_case,
    ran,
    run,
    without_field,
)

COMMANDS = (
    Wrong(
        "resume where nothing has run", ("resume", "results"), r"results: no case to resume: case\.json cannot be read"
    ),
    Wrong(
        "convert to another format",
        ("convert", "part.msh", "part.vtu"),
        r"part\.vtu: the name of the file to write must end in \.xdmf",
        alone=True,
    ),
    Wrong(
        "convert onto a file that exists",
        ("convert", "part.msh", "part.xdmf"),
        r"part\.xdmf: already exists; --force replaces it",
        case("", "part.xdmf"),
        alone=True,
    ),
    Wrong(
        "convert a damaged mesh",
        ("convert", "part.msh", "part.xdmf"),
        r"part\.msh: is not a MSH file of gmsh's",
        case("solid cube", "part.msh"),
        alone=True,
    ),
    Wrong(
        "resume with another mesh",
        ("resume", "results"),
        r"results: the case is no longer the one that its 2 load steps were computed from: mesh\.cells\.0 is 4, was 3; "
        r"undo the changes \(case\.json\), or run the changed case in another directory",
        ran(*STEPS[1::2], then=edit_written_case),
    ),
    Wrong(
        "a directory that belongs to another run",
        run(),
        r"results is in use by process 7 on elsewhere, since .* \(coulomb run\), which cannot be seen from .*; if that "
        r"run is known to have ended, remove results/run\.lock",
        another_run,
        library="cannot be seen from ",
    ),
    Wrong(
        "resume with a step cut short",
        ("resume", "results"),
        r"results/steps/0002/solution\.h5: .*; the last whole load step is 1: to continue from there, move "
        r"steps/0002 out of results, then: coulomb resume results",
        ran(*STEPS[1::2], then=cut("results/steps/0002/solution.h5")),
        library="solution.h5: ",
    ),
    Wrong(
        "a history where another one is",
        run(*STEPS[1::2]),
        r"results already holds 2 load steps: continue with `coulomb resume results`, replace them by ",
        ran(*STEPS[1::2]),
    ),
    Wrong(
        *("another case where there are results", run("contact.friction=0.4")),
        *(r"results holds the results of another case \(contact\.friction is 0\.4, was 0\.3\): replace them ", ran()),
    ),
    Wrong(
        *("a file of the user in place of results", (*run(), "--output", ".")),
        *(r"history\.csv is not known to be a result of coulomb", case("1;2", "history.csv")),
    ),
    Wrong("check where nothing has run", ("check", "."), r"summary\.json: cannot be read: No such file", alone=True),
    Wrong(
        "check of results cut short",
        ("check", "results"),
        r"results: is incomplete: ",
        ran(then=cut("results/solution.h5")),
        alone=True,
        library="is incomplete: ",
    ),
    Wrong(
        "check of a summary that is none",
        ("check", "."),
        r"summary\.json: has no 'law'",
        case("{}", "summary.json"),
        alone=True,
    ),
    Wrong(
        "check of results of another version",
        ("check", "results"),
        r"contact\.xdmf: shows other data than contact\.h5 has: Function/face/0: incomplete, or written by another "
        "version of coulomb: run the case again",
        ran(then=without_field),
        alone=True,
    ),
    Wrong(
        "check of a history without one of its steps",
        ("check", "results"),
        r"0001: is incomplete or missing, but there is a step 0002",
        ran(*STEPS[1::2], then=lambda: Path("results/steps/0001/summary.json").unlink()),
        alone=True,
    ),
    Wrong("check on two ranks", ("check", "."), r"coulomb check runs on one rank", alone=None),
    Wrong(
        "export of Tresca friction",
        ("export", "case.toml", "out.hdf5", "--set", "contact={face='bottom',slip_stress=1e6}"),
        r"FCLIB's problems have Coulomb's law; this case has a cohesion or a slip stress",
        alone=True,
    ),
    Wrong(
        "export of orthotropic friction",
        (
            *("export", "case.toml", "out.hdf5", "--set", "contact.friction=[0.3,0.1]"),
            *("--set", "contact.direction=[1,0,0]"),
        ),
        r"FCLIB's problems have one coefficient of friction per contact; this case has two",
        alone=True,
    ),
    Wrong("new where a file is", ("new", "block", "case.toml"), r"case\.toml: already exists; --force replaces it"),
    Wrong(
        "new in a directory that is not there",
        ("new", "block", "there/a.toml"),
        r"there/a\.toml: cannot be written: No such",
    ),
)
