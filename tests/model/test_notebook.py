"""What a solution gives to scripts and notebooks: faces and tables as arrays, HTML, pictures, a bar."""

import sys
import types

import numpy as np
import pytest
from conftest import STEEL

from coulomb import Clamp, Contact, ContactProblem, LoadHistory, Traction, box, join, moved


def pressed(**mesh):
    contact = Contact("bottom", friction=0.3)
    return ContactProblem(
        box((1.2, 0.6, 0.4), (4, 2, 2), **mesh), STEEL, [Clamp("left")], contact, [Traction("top", (1e6, 2e6, -2e7))]
    )


@pytest.fixture(scope="module")
def solution():
    return pressed().solve()


@pytest.mark.parametrize(("cell", "degree"), [("tetrahedron", 1), ("hexahedron", 2), ("tetrahedron", 2)])
def test_the_forces_of_a_face_add_up(cell, degree):
    """Those of its facets' nodes to the force on the body; the facets to the area of the face."""
    solution = pressed(cell=cell, degree=degree).solve()
    face = solution.face("bottom")
    vertices = np.unique(face.connectivity[:, : 3 if cell == "tetrahedron" else None])
    assert face.contact_force[vertices].sum(axis=0) == pytest.approx(solution.force_on_body.sum(axis=0))
    corners = face.coordinates[face.connectivity[:, : 3 if cell == "tetrahedron" else 4]]
    sides = np.roll(corners, -1, axis=1) - corners
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum() * (0.5 if cell == "tetrahedron" else 1.0)
    assert area == pytest.approx(1.2 * 0.6)


def test_both_faces_of_a_pair():
    upper = moved(box((0.5, 0.5, 0.2), (3, 3, 1)), translate=(0.0, 0.0, 0.2))
    bodies = join(upper=upper, lower=box((0.5, 0.5, 0.2), (2, 2, 1)))
    loads = [Traction("upper:top", (0.0, 0.0, -1e6))]
    supports = [Clamp("lower:bottom"), Clamp("upper:left", "x"), Clamp("upper:front", "y")]
    solution = ContactProblem(bodies, STEEL, supports, Contact("upper:bottom", 0.2, against="lower:top"), loads).solve()
    one, other = solution.face("upper:bottom"), solution.face("lower:top")
    assert one.contact_force.sum(axis=0) == pytest.approx(-other.contact_force.sum(axis=0))
    with pytest.raises(ValueError, match="no contact face 'lower:left'; there are 'upper:bottom', 'lower:top'"):
        solution.face("lower:left")


def test_columns_of_the_contact_points(solution):
    table = solution.table()
    assert {len(column) for column in table.values()} == {len(solution.problem.surface.x)}
    assert set(table["contact_face"]) == {"bottom"}
    assert table["pressure"] @ table["area"] == pytest.approx(solution.contact_force[0::3].sum())
    assert table["friction_traction_y"] @ table["area"] == pytest.approx(solution.force_on_body[:, 1].sum())
    with pytest.raises(AttributeError, match="no 'presure'; its fields are pressure, "):
        _ = solution.face("bottom").presure


@pytest.fixture(scope="module")
def shown(solution):
    return solution._repr_html_()


def test_html(solution, shown):
    for words in ("converged", "valid", "certificate passed", "natural residual", "greatest pressure (Pa)"):
        assert words in shown
    assert "FAILED" not in shown and "NOT VALID" not in shown
    posed = solution.problem._repr_html_()
    assert "108 displacement" in posed and "traction on" in posed and "the plane of the face" in posed
    assert "load steps" in LoadHistory([1.0, 2.0])._repr_html_()


def test_pictures(solution, shown):
    pytest.importorskip("pyvista")
    assert shown.count('<img src="data:image/png;base64,') == 1
    plotter = solution.plot("pressure", scale=10.0)
    assert "contact pressure" in " ".join(plotter.scalar_bars.keys())
    plotter.close()
    with pytest.raises(ValueError, match="presure"):
        solution.plot("presure")
    axis = solution.plot_history().axes[0]
    assert axis.lines[0].get_ydata()[-1] == pytest.approx(solution.result.residual)


def test_a_bar_in_a_notebook(monkeypatch):
    """One for a solve, and one for a history; none where there is no notebook, or another display."""
    shown = []
    handle = types.SimpleNamespace(update=shown.append)
    fake = types.SimpleNamespace(HTML=str, display=lambda *_, **__: handle)
    monkeypatch.setitem(sys.modules, "IPython.display", fake)
    problem = pressed()
    problem.solve()
    assert not shown
    shell = types.SimpleNamespace(get_ipython=lambda: types.SimpleNamespace(kernel=None))
    monkeypatch.setitem(sys.modules, "IPython", shell)
    problem.solve()
    assert shown[-1].startswith('<progress max="1" value="1.000"></progress> path following')
    del shown[:]
    problem.solve(progress=lambda _: None)
    assert not shown
    list(LoadHistory([1.0, 2.0]).steps(problem))
    assert len(shown) == 3 and shown[-1].endswith("2 load steps")
