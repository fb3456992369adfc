"""The demos run as they stand."""

import json

import pytest
from conftest import ROOT, reference, run_coulomb, run_python

DEMOS = sorted((ROOT / "demos").glob("*.py"))
CASES = sorted((ROOT / "demos").glob("*.toml"))


@pytest.mark.parametrize("demo", DEMOS, ids=lambda path: path.name)
def test_script(demo, tmp_path):
    done = run_python(demo, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "certificate passed" in done.stdout


@pytest.mark.parametrize("case", CASES, ids=lambda path: path.name)
def test_case(case, tmp_path):
    done = run_coulomb("run", case, cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_readme_example(tmp_path):
    """The code of the README runs as it stands there."""
    code = (ROOT / "README.md").read_text().split("```python\n")[1].split("```")[0]
    (tmp_path / "example.py").write_text(code)
    done = run_python(tmp_path / "example.py", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "certificate passed" in done.stdout
    assert (tmp_path / "results" / "block" / "picture.png").exists()


def test_script_and_case_give_the_reference_answer(tmp_path):
    """The README's main job: p = 10 against the independent solver, from the files it leaves."""
    totals, _ = reference(10, "coulomb")
    for start in (
        lambda: run_python(ROOT / "demos" / "block.py", cwd=tmp_path),
        lambda: run_coulomb("run", ROOT / "demos" / "block.toml", "--set", "output.picture=false", cwd=tmp_path),
    ):
        assert start().returncode == 0
        contents = json.loads((tmp_path / "results" / "block" / "summary.json").read_text())
        force = contents["force_on_body"]
        expected = totals["tangential_force_on_body_N"]
        assert force["normal"] == pytest.approx(totals["total_normal_force_N"], rel=1e-6)
        assert force["tangential"] == pytest.approx(expected, rel=1e-6)
        counts = {name: contents["nodes"][name] for name in ("open", "stick", "slip")}
        assert counts == {name: totals[name] for name in counts}
        assert contents["certificate"]["natural_residual"]["value"] <= 1e-6
