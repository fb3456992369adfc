"""Validity of the small-strain theory: the linear contact condition u_n <= gap with fixed normals.

The certificate checks whether the equations of small strains are solved; this module, whether they apply.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ..arrays import BoolArray, FloatArray, in_words
from ..fem.contact import NOISE, FaceSamples, Overlap, distance_along
from ..fem.geometry import on_all_ranks
from ..linalg.reductions import Reductions
from ..units import amount
from .certificate_scales import FaceScales, place_of_largest
from .facets import ROUNDING_OF_PLACES, chords_of, deepest, largest, missed

if TYPE_CHECKING:
    from ..fem.geometry import RigidFoundation
    from .nodal_answer import NodalAnswer

_PRESSING: Final = 1e-6  # a node presses if its force is above this fraction of the largest on its bodies
_MOST: Final = 0.01  # forces above this fraction of the largest do not act where faces are apart


@dataclass(frozen=True)
class Bound:
    """Limits of a measure.

    Attributes:
        warn: Above this the linear theory is inaccurate: a warning.
        refuse: Above this the answer is invalid.
    """

    warn: float
    refuse: float


GAP_ERROR = Bound(0.05, 0.25)
"""The relative error of contact forces is about that of the gaps."""

TURN = Bound(3.0, 15.0)
"""In degrees.  sin 15 = 0.26: a quarter of the normal force acts along the foundation, and conversely."""

SLIP_OVER_CELL = Bound(1.0, math.inf)
"""A warning only: the error of fixed normals shows in the turn and the gap error."""

GRADIENT = Bound(0.05, 0.24)
"""The theory neglects half the square of the gradient: 12 % of it at 0.24.  Bonded rubber, compressed by 10 % and
sheared, reaches 0.225 in its corners; a steel block, lifted by 50 mm next to its clamp, 0.25 to 0.41."""

_MISSED: Final = 100.0
"""Largest value of `SmallStrain.between`."""

CHORD = Bound(0.1, 0.5)
"""A facet as wide as the contact of a ball has a chord h^2/(8 R) of half of the approach a^2/R: nothing is left of the
curve.  Measured with a roller between plates (docs/theory.md)."""

ROUNDING = Bound(0.1, math.inf)
"""A warning only: resultants and means are right."""

BETWEEN = Bound(0.25, 1.0)
"""Measured with a cantilever on rollers: the force is 2 to 6 % wrong below 0.7, 12 % at 2, and a roller that is narrow
beside the facets, and is not touched by any mean, gives 7 to 9."""

MODES = ("enforce", "warn")
"""An answer above a `Bound.refuse` is invalid, or gets a warning."""


OVERLAP: Final = Bound(0.1, 0.1)
"""Of the motion of two surfaces relative to each other, the part that they may be inside each other."""


UNSTABLE: Final = Bound(0.0, 0.0)
"""Directions of instability: an answer that a touch destroys is none."""

BY_FRICTION: Final = Bound(0.0, math.inf)
"""A warning only."""


def _finer(value: float, bound: Bound) -> str:
    """How many times smaller facets have to be for a measure that goes with the square of their size."""
    return f"{max(math.sqrt(value / bound.warn), 1.1):.2g}"


def _directions(count: int) -> str:
    return f"{count} direction{'s'[: count != 1]}"


@dataclass(frozen=True)
class SmallStrain:
    """Measures of the nonlinearity that the linear contact conditions neglect.

    Attributes:
        gap_error: Largest distance of a pressing node, where it has moved to, from the foundation as it is, with the
            given gap, over the mean displacement of the forces that deform the bodies of its contact (`FaceScales`);
            against another deformable face what the distance differs by from the linear one, of open nodes their depth.
        turn: Largest angle in degrees between the foundation's normals at a node in contact before and after its
            displacement; in large motions between the directions of a curved guide, a support along normals or by
            place, at a node that it holds.
        slip_over_cell: Largest tangential displacement of a pressing node on a curved foundation, or against another
            deformable face, over the size of the cells there: square root of the nodal area, of slices the width along
            the section.
        gradient: Largest norm of the displacement gradient in a cell: strain and rotation.
        between: Largest depth of a face inside its foundation or the face opposite, between contact points, less what
            the chord of its facets explains, over the same mean displacement; or how far it is apart from the face
            opposite around a contact point that presses: an average beyond its end.
        chord: How far gaps are from linear between contact points of which one presses, the chord h^2/(8 R) of facets,
            over the mean approach of the bodies of their contact: work of the forces that deform these, over the sum of
            the normal forces on them; of facets that the master covers in part if half of the force acts there; of a
            face that presses nowhere, the chord beyond the gap that is left.  Where both sides have the same curvature
            there is no such chord.
        rounding: The same where it is below 1e-8 of the extent of the face: by rounding errors of the coordinates.
        overlap: Largest depth of a node of the surface inside a body, or inside a foundation beside its contact face,
            where no contact judges it, over the motion of the two relative to each other (`fem.contact.overlaps`).
        inside: Where that is; None below 5 %.
        off: Where the gap error is, and how much in metres.
        unstable: Directions in which an equilibrium of large motions is unstable, with all nodes in contact held.
        by_friction: Directions in which it is stable only as long as friction holds.
    """

    gap_error: float
    turn: float
    slip_over_cell: float
    gradient: float
    between: float
    chord: float
    rounding: float = 0.0
    overlap: float = 0.0
    inside: Overlap | None = None
    off: str = ""
    unstable: int = 0
    by_friction: int = 0

    @property
    def warnings(self) -> tuple[str, ...]:
        """Messages on measures above their limits, violations included; empty if there are none."""
        return tuple(
            text for value, bound, text in self._measures() if not value <= bound.warn
        )  # nan exceeds every bound

    @property
    def violations(self) -> tuple[str, ...]:
        """Messages on measures above `refuse`, which make the answer invalid; empty if there are none."""
        return tuple(
            f"{text} (limit {bound.refuse:g})" for value, bound, text in self._measures() if not value <= bound.refuse
        )

    def entry(self) -> dict[str, Any]:
        """The measures and their messages in summary.json."""
        inside = None if self.inside is None else {name: _plain(value) for name, value in vars(self.inside).items()}
        messages = {"warnings": list(self.warnings), "violations": list(self.violations)}
        return {**{name: getattr(self, name) for name in MEASURES}, "inside": inside, **messages}

    @property
    def mere_warnings(self) -> tuple[str, ...]:
        """The warnings that are not violations."""
        measures = self._measures()
        return tuple(text for value, bound, text in measures if bound.warn < value <= bound.refuse)

    def _measures(self) -> tuple[tuple[float, Bound, str], ...]:
        """Every measure with its bounds and its message."""
        return (
            (  # causes first: what follows may be their consequence
                self.gradient,
                GRADIENT,
                f"displacement gradients reach {self.gradient:.2g}: strains or rotations are no longer small "
                '(kinematics = "large" computes large ones)' + (_UNITS if self.gradient > 1.0 else ""),
            ),
            (
                self.slip_over_cell,
                SLIP_OVER_CELL,
                f"nodes move by {self.slip_over_cell:.1f} cells along a curved foundation or another body, but keep "
                'their normals, and the nodes opposite (kinematics = "large" follows them)',
            ),
            (
                self.gap_error,
                GAP_ERROR,
                f"{self._since}the curvature of the foundation, or of the face opposite, matters: contact nodes are "
                f"{self.gap_error:.0%} of the deformation off it{self.off} (smaller load, or smaller load steps with "
                'the foundation moved to its new place; between deformable faces kinematics = "large")',
            ),
            (
                self.turn,
                TURN,
                f"the normal of the foundation, or of a curved guide, turns by {self.turn:.1f} degrees under a moving "
                "node (supports keep their directions: in large motions let a smooth contact guide the face)",
            ),
            (
                self.between,
                BETWEEN,
                f"between the contact points the face is up to {self.between:.0%} of the deformation inside the "
                "foundation or the face opposite, or apart from it where it presses: the facets are too large for it "
                "(on the contact face at least "
                f"{_finer(self.between, BETWEEN)} times smaller ones, since the depth goes with "
                "the square of their size; of a pair also, as the slave, the face that ends within the other)",
            ),
            (
                self.chord,
                CHORD,
                f"the facets in contact are coarse: between contact points gaps are up to {self.chord:.0%} of the mean "
                "approach from linear, the chord h^2/(8 R), and the approach is uncertain by as much (facets there at "
                f"least {_finer(self.chord, CHORD)} times smaller, or cells of second order; of "
                "a pair also the curved face as the slave, or the surface that it stands for: [contact.surface])"
                if self.chord < 0.99 * _MISSED
                else "the facets are coarse where faces touch or may touch: between contact points the chord h^2/(8 R) "
                "is many times the approach, or beyond the gap of a face that presses nowhere (smaller facets there, "
                "or cells of second order)",
            ),
            (
                self.rounding,
                ROUNDING,
                f"coordinates of the contact faces have rounding errors of {self.rounding:.0%} of the mean approach, "
                "and pressures differ by as much from node to node (a mesh file with more digits)",
            ),
            (self.overlap, OVERLAP, self._overlap),
            (
                self.unstable,
                UNSTABLE,
                f"the equilibrium is unstable in {_directions(self.unstable)}, and no friction holds it: the body "
                'snaps or buckles to another one (field instability_mode; [solver] branch = "stable" goes there)',
            ),
            (
                self.by_friction,
                BY_FRICTION,
                f"the equilibrium is stable in {_directions(self.by_friction)} only as long as friction holds",
            ),
        )

    @property
    def _since(self) -> str:
        """The cause of an error of gaps, if it is known."""
        return (
            ""
            if self.slip_over_cell <= SLIP_OVER_CELL.warn
            else f"since nodes move by {self.slip_over_cell:.1f} cells, "
        )

    @property
    def _overlap(self) -> str:
        said = f"surfaces run through each other, by {self.overlap:.0%} of their motion relative to each other"
        if self.inside is None:
            return said
        (face, through), depth = self.inside.faces, self.inside.depth
        return (
            f"{said}: {face} is {amount(depth)} inside, through {through}, at x = ({in_words(self.inside.place)}): let "
            "these faces belong to a contact ([auto_contact] finds pairs)"
        )


MEASURES: Final = tuple(field.name for field in fields(SmallStrain) if field.name not in ("inside", "off"))
"""Names of the numbers among the attributes."""


_UNITS: Final = "; so large they mostly are where young, loads and mesh are in different units"


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def known_mode(mode: str) -> str:
    """The mode, if it is known.

    Raises:
        ValueError: If it is unknown.
    """
    if mode not in MODES:
        raise ValueError(f"small_strain must be {' or '.join(map(repr, MODES))}, but is {mode!r}")
    return mode


def small_strain(
    at_nodes: NodalAnswer,
    cells: FloatArray,
    foundations: Sequence[RigidFoundation | None],
    scales: FaceScales,
    gradient: float,
    between: Sequence[FaceSamples],
    inside: Overlap | None,
    large: bool,
    of_pairs: tuple[FloatArray, FloatArray],
) -> SmallStrain:
    """Measure an answer; collective.

    Args:
        at_nodes: The answer at the contact nodes.
        cells: Size of the cells there, metres, shape (m,).
        foundations: Foundation of each contact face at this time; None against a deformable face.
        scales: Of the bodies of each contact face.
        gradient: Largest norm of the displacement gradient; 0 of large motions, in which it may have any size.
        between: Places on each contact face.
        inside: The largest overlap of surfaces.
        large: Whether places are those after a large motion: nodes on a foundation may have got there, and do not tell
            that their facets stand for a face of its curvature.
        of_pairs: By how much distances from faces opposite change otherwise than linear ones, and how deep these are
            inside each other between contact points, or apart around them, metres, shapes (m,) and (2, m).
    """
    over = Reductions(at_nodes.comm)
    pressing = at_nodes.force[:, 0] > _PRESSING * scales.force[at_nodes.part]
    way, part = at_nodes.displacement_vectors[pressing], at_nodes.part[pressing]
    before, moved = at_nodes.x[pressing], at_nodes.x[pressing] + way
    rounding = ROUNDING_OF_PLACES * max(over.max(np.abs(at_nodes.x)), over.max(np.abs(moved)), 0.0)

    def measure() -> tuple[FloatArray, FloatArray]:
        distance, turn = np.zeros(len(before)), np.zeros(len(before))
        for number, foundation in enumerate(foundations):
            here = part == number
            if foundation is not None and np.any(here):
                cosine = np.einsum("ki,ki->k", foundation.normal(before[here]), foundation.normal(moved[here]))
                turn[here] = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
                beyond = _beyond(at_nodes, pressing, here, foundation)
                distance[here] = np.abs(foundation.signed_distance(moved[here]) + beyond)
        return np.where(distance < rounding, 0.0, distance), np.where(turn < 1e-5, 0.0, turn)

    try:
        distance, turn = on_all_ranks(measure, "contact: foundation", at_nodes.comm)
    except ValueError:  # no distance or normal there: far outside
        distance, turn = np.full((2, len(before)), math.nan)
    apart: FloatArray = np.zeros(len(pressing))
    depths = deepest(at_nodes, foundations, between, large)
    off, (depth, away) = of_pairs
    depth = np.where(at_nodes.force[:, 0] > _MOST * scales.force[at_nodes.part], np.maximum(depth, away), depth)
    for number in range(len(foundations)):
        deep, place = (of[at_nodes.part == number] for of in (depth, np.abs(at_nodes.x)))
        if largest(deep, over) > NOISE * largest(place, over):
            depths[number] = max(depths[number], largest(deep, over))
    if not large:
        off = np.where(np.abs(off) < rounding, 0.0, off)
        apart = np.where(pressing, np.abs(off), -np.minimum(at_nodes.gap - at_nodes.displacement[:, 0] + off, 0.0))
        apart[apart < rounding] = 0.0
    apart[pressing] = np.maximum(apart[pressing], distance)
    off_by = _relative(apart, scales.deformation[at_nodes.part])
    gap_error = largest(off_by, over)
    where = place_of_largest(off_by, at_nodes.x, at_nodes.part, at_nodes.faces, over)
    chords, rounded = chords_of(at_nodes, pressing, foundations, between)
    chords = np.maximum(chords, missed(at_nodes, pressing, foundations, between))
    chord, rounded = (_relative(one, scales.approach) for one in (chords, rounded))
    deep = _relative(depths, scales.deformation)
    pairs = np.isin(part, [number for number, foundation in enumerate(foundations) if foundation is None])
    # Normals are those at the undeformed node, of the foundation at its current place; and a node keeps what it is
    # opposite to on a deformable face.
    along = np.linalg.norm((at_nodes.displacement[:, 1:] / at_nodes.scale)[pressing], axis=1)
    return SmallStrain(
        gap_error=gap_error,
        turn=largest(turn, over),
        slip_over_cell=largest(np.where((turn > 0.0) | pairs, along / cells[pressing], 0.0), over),
        gradient=gradient,
        between=float(np.max(deep, initial=0.0)),
        chord=float(np.max(chord, initial=0.0)),
        rounding=float(np.max(rounded, initial=0.0)),
        overlap=0.0 if inside is None else inside.depth / inside.approach,
        inside=inside,
        off=f", {amount(largest(apart[~(off_by < gap_error)], over), 'm')} {where}",
    )


def _relative(depth: FloatArray, scale: FloatArray) -> FloatArray:
    """Depths over the deformation, at most `_MISSED`: a body that touches nothing is not deformed."""
    least = np.maximum(scale, depth / _MISSED)
    return np.minimum(depth / np.where(least == 0.0, 1.0, least), _MISSED)


def _beyond(answer: NodalAnswer, pressing: BoolArray, here: BoolArray, foundation: RigidFoundation) -> FloatArray:
    """What the initial gap of contact points is beyond their distance from the foundation: it is a mean over several
    nodes, or an additional gap is given.

    Args:
        answer: The answer at all contact points.
        pressing: Which of them press.
        at: Which of these are on the face of the foundation.
    """
    x, n, gap = (values[pressing][here] for values in (answer.x, answer.frames[:, 0], answer.gap))
    return gap - distance_along(n, x, foundation.signed_distance(x), foundation)
