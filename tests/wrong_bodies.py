"""Wrong cases of several bodies: rows of the table of wrong_inputs.py."""

from wrong_input import Wrong, case, part, run

BODIES = """
[[body]]
name = "lower"
box = [1.0, 1.0, 1.0]
cells = [1, 1, 1]
[body.material]
young = 2e11
poisson = 0.3

[[body]]
name = "upper"
box = [1.0, 1.0, 1.0]
cells = [1, 1, 1]
translate = [0.0, 0.0, 1.0]
[body.material]
young = 2e11
poisson = 0.3

[[clamp]]
face = "lower:bottom"

[[clamp]]
face = "upper:top"

[contact]
face = "upper:bottom"
against = "lower:top"
friction = 0.3
"""
THIRD = """[[body]]
name = "lid"
box = [1.0, 1.0, 1.0]
cells = [1, 1, 1]
translate = [0.0, 0.0, 5.0]
material = { young = 1e9, poisson = 0.3 }

"""
two = case(BODIES)
one_read = part(after=lambda data: data)


def from_file():
    """A body of a file beside one of a box."""
    one_read()
    two()


SEVERAL = (
    Wrong(
        "a misspelt body",
        run("contact.against='lowr:top'"),
        r"contact\.against = 'lowr:top': there is no body 'lowr' \(did you mean 'lower'\?\); the bodies are lower",
        two,
    ),
    Wrong(
        "a face without its body",
        run("clamp=[{face='bottom'}]"),
        r'clamp\.0\.face = \'bottom\': should name body and face, as in "lower:bottom"; the bodies are lower, upper',
        two,
    ),
    Wrong(
        "a body without its face",
        run("clamp=[{face='lower:'}]"),
        r"clamp\.0\.face = 'lower:': should be 'lower:left', .* or 'lower:top'",
        two,
    ),
    Wrong(
        "a misspelt face of a body's file",
        run("body.0={name='lower', file='part.msh', material={young=1e9, poisson=0.3}}", "contact.against='lower:tpo'"),
        r"contact: body 'lower' has no face 'lower:tpo' \(did you mean 'lower:top'\?\); its faces are lower:left",
        from_file,
    ),
    Wrong(
        "an unknown group of a body's file",
        run("body.0={name='lower', file='part.msh', material=[{cells='sof', young=1e9, poisson=0.3}]}"),
        r"material: body 'lower' has no cell group 'lower:sof' \(did you mean 'lower:soft'\?\)",
        from_file,
    ),
    Wrong(
        "two bodies of one name",
        run("body.1.name='lower'"),
        r"body\.0 and body\.1 have the name 'lower'; give each body its own",
        two,
    ),
    Wrong(
        "a body's name with a colon",
        run("body.1.name='up:per'"),
        r"body\.1\.name = 'up:per': should be an identifier: letters, digits and _",
        two,
    ),
    Wrong(
        "a mesh beside bodies",
        run("mesh={box=[1,1,1], cells=[1,1,1]}"),
        r"mesh = .*: every \[\[body\]\] has its own, box or file; leave out \[mesh\]",
        two,
    ),
    Wrong(
        "a material beside bodies",
        run("material={young=1e9, poisson=0.3}"),
        r"material = .*: every \[\[body\]\] has its own, \[body\.material\]; leave out \[material\]",
        two,
    ),
    Wrong(
        "a body without a material",
        run("body.1={name='upper', box=[1,1,1], cells=[1,1,1]}"),
        r"body\.1\.material: is missing",
        two,
    ),
    Wrong(
        "a rotated body without an axis",
        run("body.1.rotate={angle=0.1}"),
        r"body\.1\.rotate\.axis: is missing",
        two,
    ),
    Wrong(
        "a foundation beside against",
        run("contact.foundation={point=[0,0,1], normal=[0,0,1]}"),
        r"contact = .*: foundation does not go with against: it is for rigid foundations",
        two,
    ),
    Wrong(
        "a face against itself",
        run("contact.against='upper:bottom'"),
        r"contact = .*: against must be another face than face",
        two,
    ),
    Wrong(
        "one body in single brackets",
        run("body={name='lower'}"),
        r"body: there may be several: write \[\[body\]\], with double brackets, in place of \[body\]",
        two,
    ),
    Wrong(
        "export of a body that contact alone holds",
        ("export", "case.toml", "out.hdf5", "--set", "clamp=[{face='lower:bottom'}]"),
        r"contact alone holds a body: its equilibrium is not in FCLIB's problems",
        two,
        alone=True,
    ),
    Wrong(
        "a body that nothing holds or touches",
        run(),
        r'nothing holds body "lid": it has no contact face',
        case(BODIES.replace("[[clamp]]", THIRD + "[[clamp]]", 1)),
    ),
    Wrong(
        "a probe where two bodies touch",
        run("probe=[{name='heel', point=[0.5,0.5,1]}]"),
        r"probe 'heel': the point is in the bodies 'lower' and 'upper': give body, one of them",
        two,
    ),
    Wrong(
        "a probe in none of the bodies",
        run("probe=[{name='heel', point=[0.5,0.5,3]}]"),
        r"probe 'heel': body 'lower': the point \(0\.5, 0\.5, 3\) is outside the body; .* at a distance of 2 m; probe "
        r"'heel': body 'upper': .* at a distance of 1 m",
        two,
    ),
    Wrong(
        "a probe in an unknown body",
        run("probe=[{name='heel', point=[0.5,0.5,1], body='uper'}]"),
        r"probe 'heel': there is no body 'uper'; the bodies are lower, upper",
        two,
    ),
)
