"""Case files: reading, and messages about wrong ones."""

import pytest
from conftest import ROOT

from coulomb import Clamp, InteriorPoint, PrescribedDisplacement, SuccessiveTresca
from coulomb.case.case import read_case
from coulomb.solvers import SchurComplementSystem

BLOCK = ROOT / "demos" / "block.toml"


def test_changes():
    case = read_case(
        BLOCK,
        [
            "mesh.cells=[6, 2, 2]",
            "mesh.cell=tetrahedron",
            "clamp.0.components=xyz",
            "traction.1.value=[0, 0, 1]",
            "contact={face='bottom', slip_stress=1e7}",
            "solver.newton=schur",
        ],
    )
    assert case.mesh.cells == (6, 2, 2) and case.mesh.cell == "tetrahedron"
    assert case.traction[1].value == (0.0, 0.0, 1.0)
    assert case.contact.friction is None
    solver = case.contact_solver()
    assert isinstance(solver, InteriorPoint) and solver.newton == SchurComplementSystem(rank=0)


def test_solver_and_problem_are_what_the_case_says():
    case = read_case(
        BLOCK,
        [
            "mesh.cells=[3,1,1]",
            "solver={tolerance=1e-7, linear_solver='iterative', compliance='matrix-free', method='successive-tresca', "
            "max_outer=5}",
            "contact.foundation={point=[0,0,-1e-4], normal=[0,0,1]}",
            "clamp.0.value=[0,0,-1e-4]",
            "body_force=[0,0,-1e4]",
        ],
    )
    solver = case.contact_solver()
    assert isinstance(solver, SuccessiveTresca) and solver.tolerance == 1e-7 and solver.max_iterations == 5
    problem = case.problem()
    assert problem.A.name == "matrix-free" and problem.body.stiffness.solver.name.startswith("iterative")
    assert problem.surface.gap == pytest.approx(1e-4)
    assert problem.loading.prescribed.min() == -1e-4
    assert problem.loading.load[:, 2].sum() == pytest.approx(-4e7 * 3 - 1e4 * 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("material.poisson=-1.0", r"material.poisson = -1.0: should be greater than -1"),
        ("material.young=nan", r"material.young = nan: should be a finite number"),
        ("clamp.0.components='xw'", r"clamp.0.components = 'xw': should be 'x', 'y'"),
        ("contact={face='bottom'}", r"contact = .*: give either friction \(Coulomb\) or slip_stress \(Tresca\)"),
        ("contact.foundation={point=[0,0,0]}", r"needs normal"),
        (
            "contact.friction={pressure=[0, 1e7], coefficient=[0.3]}",
            r"contact.friction = .*: friction: pressures must asc",
        ),
        ("contact.friction={pressure=[0, 1e7]}", "contact.friction.coefficient: is missing"),
        ("contact.friction_limit=0", "friction_limit must be a stress > 0"),
        ("contact={face='bottom', slip_stress=1e6, friction_limit=1e6}", "friction_limit goes with friction"),
        (
            "contact={face='bottom', friction={pressure=[0], coefficient=[0.3]}, direction=[1,0,0]}",
            "by slip rate or pres",
        ),
        (
            "mesh.size=0.1",
            r"mesh.size = 0.1: there is no such key: write cells = \[30, 10, 10\], the numbers along",
        ),
        ("contact.region=[{box=[[0,0,0],[1,1,1]], mu=0.2}]", r"contact.region.0.mu = 0.2: .*: write friction = 0.2$"),
        ("contact.mu=0.3", r"contact.mu = 0.3: there is no such key: write friction = 0.3$"),
        ("contact.interference=2e-5", r"no such key: write gap = -2e-05$"),
        ("contact.penalty=1e9", r"leave it out: contact and friction are exact"),
        ("material.E=2e11", r"write young = 2e\+11$"),
        ("solver.nlgeom='YES'", r'write kinematics = "large"$'),
        ("fixed='left'", r'write \[\[clamp\]\], and below it face = "left"$'),
        ("contacts=[{face='bottom', friction=0.3}]", r'\[\[contact\]\], and below it face = "bottom", friction = 0.3$'),
        ("traction.0={face='right', magnitude=-1e6}", r"magnitude = .*: write value = \[0.0, 0.0, -1e\+06\]$"),
        ("pressure=[{face='right', value=[0, 3e6, -4e6]}]", r"expression in quotation marks: write value = 5e\+06$"),
        ("gravity=-9.81", r"write gravity = \[0.0, 0.0, -9.81\]$"),
        ("mesh.cells=6", r"write cells = \[6, 6, 6\]$"),
        ("mesh.element='C3D10'", r'write cell = "tetrahedron"$'),
        ("clamp.0.components=[1, 3]", r'write components = "xz"$'),
        ("clamp.0.dofs='1-3'", r'write components = "xyz"$'),
        ("clamp.0.face='ZMIN'", r"or 'top': write 'bottom'$"),
        ("displacement=[{face='top', u_z=-1e-4}]", r'"top", components = "z", value = \[0.0, 0.0, -0.0001\]$'),
        ("bolt=[{face='top', preload=9}]", r'write \[\[pretension\]\], and below it face = "top", force = 9$'),
        (
            "contact={slave='bottom', friction=0.3}",
            "or false, not text: write face = .bottom.$",
        ),
        ("contact.friction_angle=45", r"write friction = 1.0, the tangent of the angle$"),
        (
            "contact.sphere={center=[0, 0, -1], r=1}",
            r'foundation = \{ shape = "sphere", centre = \[0, 0, -1\], radius = 1',
        ),
        ("contact.foundation.diameter=3", r"write radius = 1.5$"),
        ("contact.velocity=[1, 0, 0]", r"write motion = \[\[0.0, 0.0, 0.0, 0.0\], \[1.0, 1, 0, 0\]\], rows"),
        ("material.name='Steel'", r"write young = 2.1e\+11, poisson = 0.3, or"),
        ("material.young='210 GPa'", r"not text: write young = 2.1e\+11$"),
        ("material.fix='left'", r'write \[\[clamp\]\], and below it face = "left"$'),
        ("units={length='millimetre'}", r"write length = .mm.$"),
        ("units.force='kN'", r"no such key: leave it out: it follows from length and stress$"),
        ("output.format='vtk'", r"write format = \[\"xdmf\", \"vtkhdf\"\]$"),
        ("material.young='2e11'", r"not text: write young = 2e\+11$"),
        ("material.poisson=0.7", r"should be less than 0.5, for example poisson = 0.3$"),
        ("material.young.x=1", r"--set material.young.x=1: there is no such place"),
    ],
)
def test_bad_settings(change, message):
    with pytest.raises(ValueError, match=message):
        read_case(BLOCK, [change])


def test_a_clamp_with_a_value_is_a_prescribed_displacement():
    value = (0.0, 0.0, -1e-4)
    (old,) = (t.support() for t in read_case(BLOCK, ["clamp.0.value=[0,0,-1e-4]"]).clamp)
    changes = ["clamp=[]", "prescribed_displacement=[{face='left', value=[0,0,-1e-4]}]"]
    (new,) = (t.support() for t in read_case(BLOCK, changes).prescribed_displacement)
    assert type(old) is type(new) is PrescribedDisplacement and old == new == PrescribedDisplacement("left", value)
    assert type(read_case(BLOCK).clamp[0].support()) is Clamp


JAWS = """
mesh = { box = [0.1, 0.1, 0.05], cells = [3, 3, 2] }
material = { young = 1e7, poisson = 0.3 }
spring = [{ face = "left", stiffness = 1e4 }, { face = "right", stiffness = 1e4 }]
history = { times = [1.0] }
[[contact]]
face = "bottom"
friction = 0.4
[[contact]]
face = "top"
friction = 0.2
motion = [[0, 0, 0, 0], [1, 0, 0, -1e-3]]
foundation = { point = [0, 0, 0.05], normal = [0, 0, -1] }
region = [{ box = [[0, 0, 0], [0.05, 0.1, 0.1]], friction = 0.1 }]
"""


def test_several_faces(tmp_path):
    path = tmp_path / "jaws.toml"
    path.write_text(JAWS)
    case = read_case(path)
    problem = case.problem()
    assert problem.surface.faces == ("bottom", "top")
    top = problem.surface.part == 1
    assert set(problem.law.friction[~top]) == {0.4} and set(problem.law.friction[top]) == {0.1, 0.2}
    (step,) = case.load_history().steps(problem)
    assert step.solution.certificate.passed
    for change, message in (
        ("contact.1.face='tip'", r"contact.1.face = 'tip': should be 'left'"),
        ("contact.1.frictoin=1", r"contact.1.frictoin = 1: there is no such key; did you mean friction\?"),
        ("contact=[]", r"contact = \[\]: .*at least 1"),
        ("contact.1.region.0.box=[[9,9,9],[10,10,10]]", r"contact.1.region.0: there is no contact node in its box"),
    ):
        with pytest.raises(ValueError, match=message):
            read_case(path, [change]).problem()
