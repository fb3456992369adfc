"""Wrong inputs: their messages on one rank and on two are those of docs/errors.md."""

import pytest
import wrong_inputs
from conftest import run_python
from wrong_input import DOCUMENT, Wrong, answer, document, shown
from wrong_inputs import ALL, TABLE


def test_number_of_wrong_inputs():
    assert len(ALL) >= 40 and len({wrong.what for wrong in ALL}) == len(ALL)


ANSWERS = {}
"""Code and text by input, for the document."""


@pytest.mark.parametrize("wrong", [w for w in ALL if w.alone is not None], ids=lambda wrong: wrong.what)
def test_messages(wrong: Wrong, tmp_path):
    code, text = ANSWERS[wrong.what] = answer(wrong, tmp_path)
    assert shown(wrong, code, text) in DOCUMENT.read_text(encoding="utf-8").splitlines()
    assert "Traceback" not in text and text.startswith("warning: " if code == 0 else "error: ")
    left = {path.name for path in tmp_path.iterdir()}
    if code == 2 and not any(name in getattr(wrong.prepare, "__qualname__", "") for name in ("ran.", "another_run")):
        assert "results" not in left  # nothing was started


def test_on_two_ranks():
    """Every rank has the same message, and none waits for another."""
    done = run_python(wrong_inputs.__file__, ranks=2, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "the same on 2 ranks" in done.stdout


def test_the_document_is_up_to_date():
    assert document(TABLE, ANSWERS) == DOCUMENT.read_text(encoding="utf-8"), "run python tests/wrong_inputs.py"
