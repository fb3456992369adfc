"""Decks that are divided into finer and finer cells, by coulomb alone: what every division of them has in common."""

import numpy as np
import pytest
from conftest import run_coulomb

from benchmarks.refined_decks import bolt, prisms, tie
from coulomb.io.run_directory import RunDirectory


@pytest.mark.parametrize(("deck", "contacts"), [(prisms, 1), (tie, 1), (bolt, 2)])
def test_contacts_carry_the_load_in_all_divisions(deck, contacts, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for k in (1, 2):
        (tmp_path / f"deck{k}.inp").write_text(deck(k))
        run_coulomb("run", f"deck{k}.inp", "--set", "output.picture=false")
        faces = RunDirectory(tmp_path / "results" / f"deck{k}").read_summary()["faces"]
        assert np.abs([one["force"][2] for one in faces]) == pytest.approx(np.full(contacts, 3e3), rel=1e-6)
