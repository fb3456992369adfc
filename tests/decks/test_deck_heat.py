"""Decks whose steps conduct heat: temperatures, films, fluxes and the conductance of contact, beside formulas."""

import numpy as np
import pytest
from test_deck_tables import CUBES, tables_of

from coulomb import LoadHistory
from coulomb.case.case import read_case

K, H, Q, FILM = 50.0, 10.0, 1000.0, 30.0
"""Conductivity and conductance, flux and film coefficient; mm, N, s, K."""

STEADY = "*STEP\n*COUPLED TEMPERATURE-DISPLACEMENT, STEADY STATE\n{}\n*END STEP\n"


def heated(conductance, *steps):
    text = CUBES.replace("*DENSITY", f"*CONDUCTIVITY\n{K}\n*DENSITY").replace(
        "*FRICTION", f"*GAP CONDUCTANCE\n{conductance}\n*FRICTION"
    )
    text += "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nall, 20.\n"
    return text + "".join(map(STEADY.format, steps))


def top_of(solution):
    """The temperature at the top, the same at all of its nodes."""
    found = solution.heat.temperature[np.isclose(solution.problem.elasticity.x[:, 2], 2.0)]
    assert np.ptp(found) < 1e-9
    return found[0]


def test_flux_and_film_through_contact(tmp_path):
    """Two cubes in series with the contact: q (2/k + 1/h) of a flux, and with a film 1/film more."""
    flux = "*BOUNDARY\nbase, 11, 11, 30.\n*DFLUX\n2, S2, 1.D3\n*DLOAD\n2, P2, 10."
    found = tables_of(tmp_path, heated(H, flux))
    fates = {row.keyword: row.fate for row in found.cards}
    assert fates["GAP CONDUCTANCE"] == fates["DFLUX"] == "used" and not found.refused
    assert found.tables["reference_temperature"] == 20.0 and found.tables["material"]["expansion"] == 0.0
    solution = read_case(tmp_path / "deck.inp").problem().solve()
    assert solution.certificate.passed and top_of(solution) == pytest.approx(30.0 + Q * (2.0 / K + 1.0 / H), rel=1e-8)
    film = "*BOUNDARY\nbase, 11, 11, 20.\n*FILM\n2, F2, 120., 30.\n*DLOAD\n2, P2, 10."
    tables_of(tmp_path, heated("5., 0.\n15., 20.", film))
    q = 100.0 / (2.0 / K + 1.0 / H + 1.0 / FILM)  # 5 + 10 * 10/20 at 10 MPa
    solution = read_case(tmp_path / "deck.inp").problem().solve()
    assert top_of(solution) == pytest.approx(120.0 - q / FILM, rel=1e-8)


def test_temperatures_go_on_from_step_to_step(tmp_path):
    """Linearly from what they are; what is not given again stays."""
    first = "*BOUNDARY\nbase, 11, 11, 20.\ntop, 11, 11, 120.\n*DLOAD\n2, P2, 10."
    tables = tables_of(tmp_path, heated(H, first, "*BOUNDARY\nbase, 11, 11, 70.")).tables
    assert tables["heat"] == [
        {"face": "base", "temperature": 70.0, "amplitude": [[0.0, 0.0], [1.0, 0.0], [2.0, 1.0]]},
        {"face": "top", "temperature": 120.0, "amplitude": [[0.0, 0.0], [1.0, 1.0]]},
    ]
    case = read_case(tmp_path / "deck.inp")
    steps = list(LoadHistory(case.history.ends).steps(case.problem()))
    flows = [sum(abs(flow["power"]) for flow in step.solution.heat.entry()["flows"]) / 2.0 for step in steps]
    assert flows[0] / flows[1] == pytest.approx(2.0, rel=1e-8)


@pytest.mark.parametrize(
    ("cards", "message"),
    [
        ("*BOUNDARY\n3, 11, 11, 20.", r"\*BOUNDARY: temperatures of single nodes"),
        ("*DFLUX\n2, BF, 10.", r"\*DFLUX: BF on '2', some of the elements"),
        ("*END STEP\n*STEP\n*STATIC", r"\*STATIC: beside steps that conduct heat"),
    ],
)
def test_what_is_not_read_of_heat(cards, message, tmp_path):
    with pytest.raises(ValueError, match=rf"deck.inp: line \d+: {message}"):
        tables_of(tmp_path, heated(H, "*BOUNDARY\nbase, 11, 11, 20.\n" + cards))
    text = heated(H, "*DLOAD\n2, P2, 10.").replace(", STEADY STATE", "")
    assert [row.keyword for row in tables_of(tmp_path, text).refused] == ["COUPLED TEMPERATURE-DISPLACEMENT"]
    static = text.replace("COUPLED TEMPERATURE-DISPLACEMENT", "STATIC")
    found = {row.keyword: row.why for row in tables_of(tmp_path, static).cards}
    assert found["GAP CONDUCTANCE"] == "no step conducts heat"


def test_heat_that_is_given_anew(tmp_path):
    """OP=NEW: fluxes that are not given again go to 0, temperatures must be given again; heat in the volume."""
    kept = "*BOUNDARY, OP=NEW\nbase, 1, 3\ntop, 1, 2\nbase, 11, 11, 20.\n*DFLUX, OP=NEW\n2, S4, 1."
    text = heated(H, "*BOUNDARY\nbase, 11, 11, 20.\n*DFLUX\n2, S2, 3.\ncubes, BF, 2.", kept)
    found = {table.get("face"): table for table in tables_of(tmp_path, text).tables["heat"]}
    assert found["2 S2"]["amplitude"] == [[0.0, 0.0], [1.0, 1.0], [2.0, 0.0]]
    assert found[None]["source"] == 2.0 and found[None]["amplitude"][-1] == [2.0, 0.0]
    assert found["base"] == {"face": "base", "temperature": 20.0}
    with pytest.raises(ValueError, match=r"\*BOUNDARY: OP=NEW: what ends in a step while others stay"):
        tables_of(tmp_path, text.replace("base, 11, 11, 20.\n*DFLUX, OP=NEW", "*DFLUX, OP=NEW"))
