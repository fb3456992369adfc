"""Wrong inputs: their messages on one rank and on two are those of data/wrong_inputs.json."""

import pytest
import wrong_inputs
from conftest import run_python
from wrong_input import MESSAGES, Wrong, another_run, answer, known, shown
from wrong_inputs import ALL


def test_every_wrong_input_has_a_message():
    assert len({wrong.what for wrong in ALL}) == len(ALL)
    assert {wrong.what for wrong in ALL if wrong.alone is not None} == set(MESSAGES)


@pytest.mark.parametrize("wrong", [w for w in ALL if w.alone is not None], ids=lambda wrong: wrong.what)
def test_messages(wrong: Wrong, tmp_path):
    code, text = answer(wrong, tmp_path)
    assert shown(wrong, code, text) == known(wrong.what), "python tests/wrong_inputs.py writes the file anew"
    assert "Traceback" not in text and text.startswith("warning: " if code == 0 else "error: ")
    left = {path.name for path in tmp_path.iterdir()}
    if code == 2 and "ran." not in getattr(wrong.prepare, "__qualname__", "") and wrong.patch is not another_run:
        assert "results" not in left  # nothing was started


def test_on_two_ranks():
    """Every rank has the same message, and none waits for another."""
    done = run_python(wrong_inputs.__file__, ranks=2, timeout=600)
    assert "the same on 2 ranks" in done.stdout
