"""Where the gap of a contact point closes in a load step, its way before is no slip."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from case_texts import one_body
from mpi4py import MPI
from resumed_rows import rows_of, same_to_the_tolerance

from coulomb.case.case import read_case
from coulomb.case.record import write_case
from coulomb.fem.contact import way_to_touch
from coulomb.io.history_files import HistoryFiles
from coulomb.model.contact_body import ContactBody
from coulomb.recheck import check

OBLIQUE = one_body((1.0, 0.4, 0.4), (6, 2, 2), 5e6, 0.4)
OBLIQUE += """\
clamp = [{ face = "top" }]
[contact]
face = "bottom"
friction = 0.4
foundation = {shape = "sphere", centre = [0.4, 0.2, -8.0], radius = 8.0}
motion = [[0, 0, 0, 0], [4, 8e-3, 0, 12e-3]]
[history]
end = 4.0
steps = 4
"""
"""A ball comes at an angle: in every load step other nodes touch it."""


@pytest.mark.parametrize("earlier", [0.25, 1.0, 3.0])
def test_a_velocity_that_falls_with_the_root_of_the_time_to_the_touch(earlier):
    """That of the middle of the step before is its mean to the second order."""
    for touch in (0.1, 0.6, 0.9):
        mean = np.sqrt(touch + 0.5 * earlier)  # v_t in the middle of the step before
        way = np.array([[earlier, mean * earlier, -2.0 * mean * earlier]])
        found = way_to_touch(way, np.array([touch]), 1.0 / earlier)  # the normal velocity is 1
        exact = 2.0 / 3.0 * touch**1.5
        assert found[0] == pytest.approx([0.0, exact, -2.0 * exact], rel=1e-12)


def test_it_is_continuous_and_none_of_points_that_have_touched_or_do_not_come():
    way = np.array([[1.0, 3.0, -4.0]] * 3 + [[0.0, 3.0, -4.0], [-1.0, 3.0, -4.0]])
    assert not np.any(way_to_touch(way, np.array([0.0, -1e-9, 0.0, 1.0, 1.0]), 1.0))
    gaps = np.array([1e-9, 1.0 - 1e-9, 1.0 + 1e-9, 1e9])
    found = np.linalg.norm(way_to_touch(np.repeat(way[:1], 4, axis=0), gaps, 1.0), axis=1)
    assert found[1] == pytest.approx(found[2], rel=1e-8) and found[1] == pytest.approx(10.0 / 3.0 * np.sqrt(2.0 / 3.0))
    assert np.all(found[[0, 3]] < 1e-8)


def test_it_is_in_the_files_and_a_history_continues_with_it(tmp_path, monkeypatch):
    case = tmp_path / "case.toml"
    case.write_text(OBLIQUE)
    settings, folders = read_case(case), [tmp_path / name for name in ("whole", "continued")]
    problem, history = settings.problem(), settings.load_history()
    history.run(problem, HistoryFiles(folders[0]))
    shutil.copytree(*folders)
    for number in (3, 4):
        shutil.rmtree(folders[1] / "steps" / f"{number:04d}")
    history.run(settings.problem(), HistoryFiles(folders[1], resume=True))
    rows = zip(*map(rows_of, folders), strict=True)
    assert [same_to_the_tolerance(*pair) for pair in rows] == [True] * 4
    for folder in folders:
        write_case(settings, folder, MPI.COMM_SELF)
        assert check(folder).passed
    assert check(folders[0] / "steps" / "0003").passed
    monkeypatch.setattr(ContactBody, "flown", lambda self, surface, *_: np.zeros_like(surface.x))
    found = check(folders[0])
    assert [bool(step.faults) for step in found.steps] == [False, True, True, True]
    assert all(any("slip_origin" in fault for fault in step.faults) for step in found.steps[1:])


def test_derivatives_of_a_history_follow_it(tmp_path):
    """Of the friction, of Young's modulus and of the way of the ball, beside differences; and backwards."""

    def steps(young=1.0, friction=1.0, motion=1.0):
        ways = ", ".join(f"{way * motion!r}" for way in (8e-3, 0.0, 12e-3))
        text = OBLIQUE.replace("friction = 0.4", f"friction = {0.4 * friction!r}").replace("8e-3, 0, 12e-3", ways)
        (tmp_path / "case.toml").write_text(text)
        settings = read_case(tmp_path / "case.toml", [f"material.young={5e6 * young!r}"])
        return replace(settings.load_history(), tolerance=1e-12).steps(settings.problem())

    found, whole = [], []
    for step in steps():
        found = step.solution.sensitivities(found)
        whole.append((step.solution, found))
    along, later = np.cos(np.arange(len(step.solution.contact_force))), None
    young = next(one for one in found if one.name == "young")
    owed = 0.0
    for solution, _ in reversed(whole):
        later = solution.gradient(along if later is None else None, later=later)
        owed += sum(map(np.sum, later.young.values()))
    assert owed == pytest.approx(along @ young.contact_force, rel=1e-6)
    size = np.linalg.norm(step.solution.contact_force)
    names = {"young": "young", "friction of 'bottom'": "friction", "motion of the foundation of 'bottom'": "motion"}
    assert {one.name for one in found} == set(names)
    for one in found:
        h = min(1e-4, 0.1 * one.step)
        more, less = ([s.solution for s in steps(**{names[one.name]: 1.0 + d})][-1] for d in (h, -h))
        change = (more.contact_force - less.contact_force) / (2.0 * h)
        assert one.contact_force == pytest.approx(change, abs=1e-5 * size), one.name
