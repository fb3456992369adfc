"""Wrong probes."""

from wrong_input import Wrong, run

PROBES = (
    Wrong(
        "a probe outside the body",
        run("probe=[{name='heel', point=[1.5,0.5,-2]}]"),
        r"probe 'heel': the point \(1\.5, 0\.5, -2\) is outside the body; the nearest point of the body is "
        r"\(1\.5, 0\.5, 0\), at a distance of 2 m",
    ),
    Wrong(
        "two probes of one name",
        run("probe=[{name='heel', point=[0,0,0]}, {name='heel', point=[1,0,0]}]"),
        r"probe: the name 'heel' is given to several probes; give each its own",
    ),
    Wrong("a probe without a point", run("probe=[{name='heel'}]"), r"probe\.0\.point: is missing"),
    Wrong(
        "a probe in the plane", run("probe=[{name='heel', point=[0,0]}]"), r"point = \[0, 0\]: should be a list of 3"
    ),
)
