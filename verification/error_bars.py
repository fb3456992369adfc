"""Error bars (`coulomb.io.error_bars`) beside true errors: how many numbers are inside, and how wide the bars are.

Known answers: manufactured solutions with contact that sticks, slides and opens, on boxes with regular and distorted
cells and on rings (`manufactured`); the press fits of Lame (`press_fit`, `ring_pair`); homogeneous states, which all
meshes have exactly (`press_fit.wedge`, `thermal`).  Without a formula: the demos block, two_blocks and pulled_block,
a block with even contact and singular edges, and Hertz, beside second order on finer meshes, extrapolated; of these
only numbers count whose error is ten times that of the reference.

Every problem is solved on three meshes, of hexahedra and tetrahedra of first and of second order, and has bars in two
ways: from coarser meshes, and as meshes from files have them, from the same cells with the other order; boxes of first
order a third time with irregular cells, from coarser ones as of large meshes of files (`coarsened`).  The meshes are
coarse, as far from the limit of small cells as those of a first try.

A number is a component of a total.  Numbers that are exact to rounding, as forces that follow from equilibrium and
those of homogeneous states, are inside or not, but have no ratio of bar to error.  Largest pressures that the bars say
to be singular are left out.

`python -m verification.error_bars` prints the numbers outside their bars.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Clamp, Material, PrescribedDisplacement, Traction, join
from coulomb.fem.meshes import JoinedMesh, NamedMesh, box, coarsened, moved, second_order, volume
from coulomb.fem.meshes.named_mesh import Grid
from coulomb.io.accuracy import TOLERANCE
from coulomb.io.answer import answer_of
from coulomb.io.error_bars import ErrorBars, extrapolated
from coulomb.model.contact import Contact
from coulomb.model.probes import Probe
from coulomb.model.problem import ContactProblem

from . import hertz, manufactured, press_fit, ring_pair
from .array_mesh import cored_box, quarter_ring
from .manufactured import Manufactured
from .table import Curve, Panel, Row, Verified, at_least

INSIDE, WIDE = 0.95, 4.0
"""Least share of numbers inside their bars, and largest median of bar over error."""

ROUNDING = 1e-6
"""Error up to which a number is exact, over the largest force, displacement, ... of the answer: a hundred times what
the tolerance of the solver leaves."""

CELLS: Mapping[int, Sequence[int]] = {1: (3, 4, 6), 2: (2, 3, 4)}
FEW: Mapping[int, Sequence[int]] = {1: (4,), 2: (3,)}
"""Cells along an edge, by the order of the elements: of the table, and of its tests."""

KINDS = tuple((cell, degree) for degree in (1, 2) for cell in ("hexahedron", "tetrahedron"))

WAYS = {
    "coarser": "from coarser meshes",
    "order": "from the other order",
    "mmg": "from coarser tetrahedra by MMG",
    "sheets": "from coarser hexahedra without sheets",
}

STEEL, ALUMINIUM, PLASTIC = Material(2.1e11, 0.3), Material(7e10, 0.33), Material(2e9, 0.35)


@dataclass(frozen=True)
class Number:
    """A component of a total: its error and its bar.

    Attributes:
        case: Name of the problem.
        mesh: Cells and their order.
        way: Of the bar, a key of WAYS.
        quantity: Place in summary.json, and component.
        values: On the meshes that are compared, the first one that of the answer, less the exact one.
        bar: nan for a largest pressure that is singular.
        order: As observed.
        exact: Whether the error is rounding.
        scale: The largest force, displacement, ... of the answer, in the unit of the number.
    """

    case: str
    mesh: str
    way: str
    quantity: str
    values: tuple[float, ...]
    bar: float
    order: float
    exact: bool
    scale: float

    @property
    def error(self) -> float:
        return abs(self.values[0])

    @property
    def inside(self) -> bool:
        return self.error <= self.bar

    def __str__(self) -> str:
        errors = ", ".join(f"{value:.2e}" for value in self.values)
        ratio = self.bar / self.error if self.error > 0.0 else math.inf
        return (
            f"{self.case}, {self.mesh}, {WAYS[self.way]}: {self.quantity}: errors {errors}; bar {self.bar:.2e}, "
            f"{ratio:.2g} of the error; order {self.order:.2f}"
        )


Known = Mapping[str, FloatArray]


@dataclass(frozen=True)
class Problem:
    """A problem with a known answer, on several meshes.

    Attributes:
        name: What it is called.
        known: Exact totals by their place in summary.json, and their uncertainty (empty: none).
        meshes: Name of a mesh, and the problem on it.
    """

    name: str
    known: Callable[[], tuple[Known, Known]]
    meshes: Sequence[tuple[str, Callable[[], ContactProblem]]]


def numbers(problem: Problem) -> Iterator[Number]:
    """All numbers of a problem, in both ways."""
    known, uncertain = problem.known()
    for mesh, make in problem.meshes:
        posed = make()
        bodies = posed.made_of
        assert isinstance(bodies, NamedMesh | JoinedMesh)
        solution, other = (one.solve() for one in (posed, posed.on(_each(bodies, _from_file))))
        for way, one in (("coarser", solution), ("order", other)):
            if way == "order" or _has_coarser(bodies):
                yield from _numbers(problem.name, mesh, way, one.error(), known, uncertain)
        if mesh.endswith("order 1") and isinstance(bodies, NamedMesh) and bodies.grid is not None:
            tetrahedra = bodies.domain.topology.cell_type.name == "tetrahedron"
            irregular = _by_mmg(bodies.grid) if tetrahedra else _cored(bodies, bodies.grid)
            if irregular is not None:
                found, way = posed.on(irregular).solve(), "mmg" if tetrahedra else "sheets"
                yield from _numbers(problem.name, mesh, way, found.error(), known, uncertain)


def _cored(mesh: NamedMesh, grid: Grid) -> NamedMesh | None:
    """A box of irregular hexahedra, and coarser ones, as large meshes of files have; None for curved bodies."""
    lengths = [float(along[-1] - along[0]) for along in grid.planes]
    if not math.isclose(volume(mesh), math.prod(lengths), rel_tol=1e-9):
        return None
    n = max(len(along) - 1 for along in grid.planes[:2])
    irregular = cored_box((lengths[0], lengths[1], lengths[2]), (n + 1) // 2 + 1, len(grid.planes[2]) - 1)
    return replace(irregular, coarser=lambda: _coarsened_again(irregular))


def _by_mmg(grid: Grid) -> NamedMesh:
    """A box of irregular tetrahedra as large as those of the grid, and coarser ones, as large meshes of files have."""
    planes = [np.interp(np.arange(2 * len(along) - 1) / 2.0, np.arange(len(along)), along) for along in grid.planes]
    mesh = coarsened(grid.make((planes[0], planes[1], planes[2])))
    return replace(mesh, coarser=lambda: _coarsened_again(mesh))


def _coarsened_again(mesh: NamedMesh) -> NamedMesh:
    coarser = coarsened(mesh)
    return replace(coarser, coarser=lambda: coarsened(coarser, again=True))


def _numbers(case: str, mesh: str, way: str, bars: ErrorBars, known: Known, uncertain: Known) -> Iterator[Number]:
    first, *others = bars.answers
    scales = dict[str, float]()
    for name, (value, unit) in first.totals.items():
        if not name.endswith("centre_of_pressure"):  # as displacements
            scales[unit] = max(scales.get(unit, 0.0), float(np.max(np.abs(value))))
    for bar in bars.bars:
        if bar.quantity not in known:
            continue
        compared = [one.totals[bar.quantity][0] for one in (first, *others) if bar.quantity in one.totals]
        for k, exact in enumerate(known[bar.quantity]):
            values = tuple(float(value[k] - exact) for value in compared)
            scale = scales[bar.unit]
            rounding = ROUNDING * scale
            doubt = float(uncertain[bar.quantity][k]) if uncertain else 0.0
            at_rounding = abs(values[0]) <= rounding
            if doubt <= (rounding if at_rounding else 0.1 * abs(values[0])):
                name = bar.quantity + ("" if len(known[bar.quantity]) == 1 else f" {'xyz'[k]}")
                yield Number(case, mesh, way, name, values, float(bar.bar[k]), bar.order, at_rounding, scale)


def _from_file(mesh: NamedMesh) -> NamedMesh:
    return replace(mesh, coarser=None)


def _each(mesh: NamedMesh | JoinedMesh, of: Callable[[NamedMesh], NamedMesh]) -> NamedMesh | JoinedMesh:
    if isinstance(mesh, NamedMesh):
        return of(mesh)
    return JoinedMesh({name: of(one) for name, one in mesh.bodies.items()})


def _has_coarser(mesh: NamedMesh | JoinedMesh) -> bool:
    bodies = [mesh] if isinstance(mesh, NamedMesh) else list(mesh.bodies.values())
    return all(one.coarser is not None for one in bodies)


# --- problems with formulas ------------------------------------------------------------------------------------------


def of_solution(made: Manufactured, distorted: bool = False, cells: Mapping[int, Sequence[int]] = CELLS) -> Problem:
    """A manufactured solution, on all kinds of cells; their numbers along an edge by order."""

    def mesh(n: int, cell: str, degree: int) -> NamedMesh:
        if made.ring:
            return quarter_ring(*made.lengths, (n // 2 + 1, n, n // 2 + 1), cell, degree)
        place = manufactured.distorted(made.lengths) if distorted else None
        return box(made.lengths, (n, n, n), cell, degree=degree, place=place)

    meshes = [
        (_mesh_name(n, cell, degree), lambda n=n, cell=cell, degree=degree: made.problem(mesh(n, cell, degree)))
        for cell, degree in KINDS
        for n in cells[degree]
    ]
    return Problem(f"{made.name}{', distorted cells' if distorted else ''}", lambda: (made.exact(), {}), meshes)


def _mesh_name(n: int, cell: str, degree: int) -> str:
    return f"{n}, {cell}, order {degree}"


def press_fits() -> Problem:
    """Of a ring on a rigid pin."""

    def known() -> tuple[Known, Known]:
        p, a, length = press_fit.lame(), press_fit.INNER, press_fit.LENGTH
        area, side = 0.5 * math.pi * a * length, p * a * length
        return {
            "totals.normal_force": np.array([p * area]),
            "totals.force": np.array([side, side, 0.0]),
            "totals.contact_area": np.array([area]),
            "totals.centre_of_pressure": np.array([2.0 * a / math.pi, 2.0 * a / math.pi, 0.5 * length]),
            "totals.greatest_pressure": np.array([p]),
            "totals.dissipated_energy": np.zeros(1),
            "maximum.displacement": np.array([press_fit.INTERFERENCE]),
            "strain_energy": np.array([0.5 * p * area * press_fit.INTERFERENCE]),
        }, {}

    sizes = {1: (3, 4, 6), 2: (2, 3, 4)}
    meshes = [
        (_mesh_name(n, cell, degree), partial(press_fit.ring, n, cell, n, degree=degree))
        for cell, degree in KINDS
        for n in sizes[degree]
    ]
    return Problem("press fit on a pin", known, meshes)


def fitted_rings() -> Problem:
    """Press fit of two rings with meshes that do not match."""

    def known() -> tuple[Known, Known]:
        p, b = ring_pair.lame(), ring_pair.FIT
        area, side = 0.5 * math.pi * b * ring_pair.LENGTH, p * b * ring_pair.LENGTH
        return {
            "totals.normal_force": np.array([p * area]),
            "totals.force": -np.array([side, side, 0.0]),
            "totals.contact_area": np.array([area]),
            "totals.greatest_pressure": np.array([p]),
            "strain_energy": np.array([0.5 * p * area * ring_pair.INTERFERENCE]),
        }, {}

    hexahedra = ("hexahedron", "hexahedron")
    meshes = [
        (_mesh_name(n, "hexahedron", degree), partial(ring_pair.rings, n, hexahedra, (degree, degree)))
        for degree, sizes in ((1, (2, 4, 6)), (2, (1, 2, 3)))
        for n in sizes
    ]
    return Problem("press fit of two rings", known, meshes)


def homogeneous() -> Problem:
    """The block on a wedge of `press_fit`, whose pressure is constant."""

    def known() -> tuple[Known, Known]:
        p = press_fit.PRESSURE
        return {
            "totals.normal_force": np.array([p]),
            "totals.contact_area": np.ones(1),
            "totals.greatest_pressure": np.array([p]),
            "totals.centre_of_pressure": np.array([0.5, 0.5, 0.0]),
        }, {}

    meshes = [
        (_mesh_name(n, cell, 1), lambda n=n, cell=cell: press_fit.wedge(cell).on(box((1.0, 1.0, 1.0), (n, n, n), cell)))
        for cell in ("hexahedron", "tetrahedron")
        for n in (2, 3, 4)
    ]
    return Problem("homogeneous pressure", known, meshes)


# --- problems with references ----------------------------------------------------------------------------------------


def reference(makes: Sequence[Callable[[], ContactProblem]]) -> tuple[Known, Known]:
    """Totals of three finer meshes, from coarse to fine, extrapolated with the order that they show, between 0.7 and 3;
    a third of that and a tenth of the last change are uncertain."""
    answers = [answer_of(make().solve(), TOLERANCE) for make in makes][::-1]
    known, uncertain = {}, {}
    for name in answers[0].totals:
        if not all(name in one.totals for one in answers):
            continue
        chain = [(one.size, one.totals[name][0]) for one in answers]
        order, _ = extrapolated(chain)
        q = min(max(order, 0.7), 3.0) if math.isfinite(order) else 1.5
        (h1, fine), (h2, middle), *_ = chain
        further = (fine - middle) / ((h2 / h1) ** q - 1.0)
        known[name], uncertain[name] = fine + further, np.abs(further) / 3.0 + 0.1 * np.abs(fine - middle)
    return known, uncertain


def block(k: int, cell: str = "hexahedron", degree: int = 1) -> ContactProblem:
    """demos/block.toml with 3k x k x k cells."""
    return ContactProblem(
        box((3.0, 1.0, 1.0), (3 * k, k, k), cell, degree=degree),
        Material(young=2.119e11, poisson=0.277),
        [Clamp("left")],
        Contact("bottom", 0.3),
        [Traction("top", (0.0, 1e7, -4e7)), Traction("right", (2e7, 0.0, 0.0))],
        probes=[Probe("sole", (1.5, 0.5, 0.0)), Probe("corner", (3.0, 1.0, 1.0)), Probe("inside", (1.0, 0.25, 0.6))],
    )


def two_blocks(size: float, degree: int = 1) -> ContactProblem:
    """demos/two_blocks.toml with so many times the cells along every edge, of the tetrahedra the contact points."""
    low, up = (tuple(max(round(size * n), 1) for n in cells) for cells in ((12, 6, 4), (10, 5, 5)))
    upper = box((0.8, 0.4, 0.4), up, "tetrahedron", degree=degree)
    return ContactProblem(
        join(lower=box((1.2, 0.6, 0.4), low, degree=degree), upper=moved(upper, translate=(0.2, 0.1, 0.4))),
        {"lower": STEEL, "upper": ALUMINIUM},
        [Clamp("lower:bottom")],
        Contact("upper:bottom", 0.4, against="lower:top", slave=True),
        [Traction("upper:top", (1.5e7, 0.0, -6e7))],
        probes=[Probe("top", (0.6, 0.3, 0.8), body="upper"), Probe("inside", (0.3, 0.2, 0.3), body="lower")],
    )


def pulled_block(n: int, cell: str = "hexahedron", degree: int = 1) -> ContactProblem:
    """The end of demos/pulled_block.toml in one step."""
    return ContactProblem(
        box((0.2, 0.1, 0.05), (4 * n, 2 * n, n), cell, degree=degree),
        PLASTIC,
        [PrescribedDisplacement("right", (2e-4, 0.0, 0.0), "xy")],
        Contact("bottom", 0.3),
        [Traction("top", (0.0, 0.0, -1e6))],
        probes=[Probe("end", (0.0, 0.05, 0.05)), Probe("sole", (0.1, 0.05, 0.0))],
    )


def clamped_top(k: int, cell: str = "hexahedron", degree: int = 1) -> ContactProblem:
    """All of the bottom slides, without friction; the edges of the clamped top are singular."""
    return ContactProblem(
        box((1.0, 0.6, 0.5), (4 * k, 2 * k, 2 * k), cell, degree=degree),
        Material(young=1e9, poisson=0.4),
        [PrescribedDisplacement("top", (0.0, 0.0, -1e-4))],
        Contact("bottom", 0.0),
        [Traction("right", (-1e4, 2e4, 0.0))],
        probes=[Probe("sole", (0.6, 0.2, 0.0)), Probe("side", (1.0, 0.3, 0.25))],
    )


def sphere(uniform: int, degree: int = 1) -> ContactProblem:
    """`hertz.problem`, pressed."""
    problem = hertz.problem(uniform).at(1.0)
    if degree == 1:
        return problem
    mesh = problem.made_of
    assert isinstance(mesh, NamedMesh)
    return problem.on(second_order(mesh))


def problems() -> list[Problem]:
    """All of them."""
    made = [
        of_solution(manufactured.sticking(("left",))),
        of_solution(manufactured.sliding(("top",)), distorted=True),
        of_solution(manufactured.partly_open(("top",))),
        of_solution(manufactured.partly_open(("left", "top"), 0.9)),
        of_solution(manufactured.ring(("right",))),
    ]
    kinds = [(1, "hexahedron"), (1, "tetrahedron"), (2, "hexahedron")]
    sizes = {1: (4, 5, 6), 2: (2, 3, 4)}
    blocks = [(_mesh_name(k, cell, d), partial(block, k, cell, d)) for d, cell in kinds for k in sizes[d]]
    pairs = [(f"{s:g} times, order 1", partial(two_blocks, s)) for s in (0.5, 0.75, 1.0)]
    pulls = [(_mesh_name(n, cell, 1), partial(pulled_block, n, cell)) for _, cell in kinds[:2] for n in (2, 3, 4)]
    tops = [
        (_mesh_name(n, cell, degree), partial(clamped_top, n, cell, degree))
        for cell, degree in KINDS
        for n in {1: (1, 2, 3), 2: (1, 2)}[degree]
    ]
    spheres = [(_mesh_name(n, "hexahedron", 1), partial(sphere, n)) for n in (3, 4, 5)]
    return [
        *made,
        press_fits(),
        fitted_rings(),
        homogeneous(),
        Problem("block", lambda: reference([partial(block, k, "hexahedron", 2) for k in (5, 7, 10)]), blocks),
        Problem("two blocks", lambda: reference([partial(two_blocks, s, 2) for s in (0.8, 1.2, 1.6)]), pairs),
        Problem("pulled block", lambda: reference([partial(pulled_block, n, degree=2) for n in (4, 5, 7)]), pulls),
        Problem("clamped top", lambda: reference([partial(clamped_top, n, degree=2) for n in (3, 4, 5)]), tops),
        Problem("Hertz", lambda: reference([partial(sphere, n, 2) for n in (4, 6, 8)]), spheres),
    ]


def few() -> list[Problem]:
    """One of them on few meshes."""
    return [of_solution(manufactured.sliding(("top",)), distorted=True, cells=FEW)]


# --- table and picture -----------------------------------------------------------------------------------------------


def share_inside(some: Sequence[Number]) -> float:
    """Of the numbers with a bar."""
    return float(np.mean([one.inside for one in some if math.isfinite(one.bar)]))


def median_width(some: Sequence[Number]) -> float:
    """Median of bar over error, of the numbers with a bar that are not exact; 1 without any."""
    ratios = [one.bar / one.error for one in some if math.isfinite(one.bar) and not one.exact]
    return float(np.median(ratios)) if ratios else 1.0


def in_words(some: Sequence[Number]) -> list[str]:
    """The numbers outside their bars."""
    return [str(one) for one in some if one.error > one.bar]


_SHARE = "what is required over all; of one case or way 8 % fewer: its numbers have the same causes"
_FIRST = "what is required"
_REPORT = "a report, which never fails: cases differ, and smooth answers of second order are better than one can tell"


def rows_of(found: Mapping[str, Sequence[Number]]) -> list[Row]:
    """Shares and widths by case, by way and order, and over all."""
    rows = []
    whole = [one for some in found.values() for one in some]
    first, second = ([one for one in whole if one.mesh.endswith(f"order {k}")] for k in (1, 2))
    groups = {**found, **_by_way(whole), "all of first order": first, "all of second order": second, "all": whole}
    for name, some in ((name, some) for name, some in groups.items() if some):
        width, strict = median_width(some), some is first or some is whole
        less = 0.0 if strict else 0.08
        rows.append(at_least(f"{name}: share of {len(some)} numbers inside", INSIDE, share_inside(some), less, _SHARE))
        title, spare = f"{name}: median of error over bar", 0.0 if strict else 1.0 / WIDE
        rows.append(at_least(title, 1.0 / WIDE, 1.0 / width, spare, _FIRST if strict else _REPORT))
    singular = sum(math.isnan(one.bar) for one in whole)
    rows.append(Row("largest pressures left out as singular", 0.0, singular, 0.0, 0.0, "a count"))
    return rows


def _by_way(whole: Sequence[Number]) -> dict[str, list[Number]]:
    return {
        f"{words}, order {order}": [one for one in whole if one.way == way and one.mesh.endswith(f"order {order}")]
        for way, words in WAYS.items()
        for order in (1, 2)
    }


def verify(some: Callable[[], Sequence[Problem]] = problems) -> Verified:
    """All problems, or some."""
    found = {one.name: list(numbers(one)) for one in some()}
    return Verified(tuple(rows_of(found)), (_panel(found),))


def _panel(found: Mapping[str, Sequence[Number]]) -> Panel:
    """Share of the numbers whose bar is at most so many times the error."""
    curves, ends, shares = [], np.array([0.0, 1.0]), np.linspace(0.01, 0.99, 50)
    for name, some in _by_way([one for every in found.values() for one in every]).items():
        ratios = [one.bar / one.error for one in some if math.isfinite(one.bar) and not one.exact]
        if ratios:
            curves.append(Curve(name, np.log10(np.quantile(ratios, shares)), shares))
    lines = [Curve(name, np.full(2, math.log10(at)), ends, formula=True) for name, at in _LINES.items()]
    return Panel("error bars", "log10(bar over error)", "share of the numbers", (*lines, *curves))


_LINES = {"bar = error: 5 % may be left of it": 1.0, "4 times: half may be right of it": WIDE}


if __name__ == "__main__":
    from coulomb.cli.console import console

    for problem in problems():
        for number in in_words(list(numbers(problem))):
            console.out(number)
