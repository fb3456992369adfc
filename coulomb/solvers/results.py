"""What a solver gives back: a status that was earned, the answer, and how it went."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any, Literal

from ..arrays import FloatArray


class Status(Enum):
    """How a solver ended."""

    CONVERGED = "converged"
    STAGNATED = "stagnated"
    OSCILLATING = "oscillating"
    DIVERGED = "diverged"
    MAX_ITERATIONS = "max_iterations"
    INTERRUPTED = "interrupted"


def check_constants(owner: object, bounds: Iterable[tuple[str, bool, str]]) -> None:
    """Refuse a solver's constant that is outside its bounds.

    Args:
        owner: The solver, a value with its constants as fields.
        bounds: For every constant its name, whether its bound holds, and what it must be.

    Raises:
        ValueError: Naming solver, constant, bound and value.
    """
    for name, holds, must in bounds:
        if not holds:
            raise ValueError(f"{type(owner).__name__}: {name} must be {must}, but is {getattr(owner, name)}")


def check_path_constants(of: Any) -> None:
    """`check_constants` of what Algorithm PF and the one loop share, with the bounds that their theory demands."""
    check_constants(
        of,
        (
            ("tolerance", of.tolerance > 0.0, "> 0"),
            ("r_tol", 0.0 < of.r_tol < 1.0, "in (0, 1)"),
            ("c_fact", 0.0 < of.c_fact < 1.0, "in (0, 1)"),
            ("gamma", 0.0 < of.gamma < 1.0, "in (0, 1)"),
            ("beta", of.beta > 0.0, "> 0"),
            ("sigma_min", 0.0 < of.sigma_min <= of.sigma_max, "in (0, sigma_max]"),
            ("sigma_max", of.sigma_max <= 0.5, "at most 1/2"),
            ("max_iterations", of.max_iterations >= 1, "at least 1"),
        ),
    )


Accept = Callable[[FloatArray], bool]
"""Whether forces in newtons, shape (3 m,), pass the certificate of the problem they belong to; collective."""


class Goal:
    """When a solver may stop: its residual is small enough, and the certificate would pass.

    The natural residual measures gaps by the mean compliance of the contact nodes.  Where soft springs hold the body,
    that compliance is the springs', and gaps that are large for the deformation are small for the residual: then
    `accept` refuses the answer, and is asked again each time the residual has halved, and once more in the end.

    Args:
        tolerance: Residual to reach.
        accept: The certificate; None where the residual alone decides.

    Attributes:
        tolerance: Residual to reach.
        residual: Residual below which the certificate is asked next.
        refused: Whether the certificate has refused an answer.
    """

    def __init__(self, tolerance: float, accept: Accept | None):
        self.tolerance = self.residual = tolerance
        self._accept = accept
        self.refused = False
        self._reached = False

    @property
    def patience(self) -> int:
        """Steps of path following without a better residual after which to give up."""
        return 5 if self.refused else 20

    def reached(self, residual: float, x: FloatArray) -> bool:
        """Whether to stop with the forces x, whose residual has been computed afresh; collective."""
        if not residual <= self.residual:
            return False
        self._reached = self._accept is None or self._accept(x)
        if not self._reached:
            self.refused, self.residual = True, 0.5 * residual
        return self._reached

    def verdict(self, residual: float, x: FloatArray, otherwise: Status) -> Status:
        """The one place where CONVERGED is assigned; collective.

        Args:
            residual: The problem's own residual at the answer, computed afresh by the problem.
            x: The answer's forces.
            otherwise: Why the solver stopped, if residual or certificate do not agree.
        """
        if not residual <= self.tolerance:
            return otherwise
        return Status.CONVERGED if self._reached or self._accept is None or self._accept(x) else otherwise

    def missed(self, residual: float) -> str:
        """What an answer that is not CONVERGED lacks, in words."""
        if self.refused and residual <= self.tolerance:
            return "below the tolerance, but the certificate does not pass"
        return f"above the tolerance {self.tolerance:.1e}"


@dataclass(frozen=True)
class QPStep:
    """One step of a QP solver.

    Attributes:
        iteration: Step number, from 1.
        residual: Natural residual of the QP after the step.
        krylov: CG iterations in the step, each one product by A.
    """

    iteration: int
    residual: float
    krylov: int


@dataclass(frozen=True)
class PathFollowingStep(QPStep):
    """One step of Algorithm PF, in the scaled variables of the solver.

    Attributes:
        theta: Duality measure nu^T z / (number of constraints) after the step.
        sigma: Centring.
        alpha: Step length.
        gradient: Root mean square of grad_x L after the step.
        krylov_tolerance: Relative tolerance asked of CG.
    """

    theta: float
    sigma: float
    alpha: float
    gradient: float
    krylov_tolerance: float


StepKind = Literal["cg", "expansion", "proportioning"]


@dataclass(frozen=True)
class ActiveSetStep(QPStep):
    """One step of KPRGP.

    Attributes:
        kind: A CG step on the free unknowns, an expansion of the active set, or a proportioning step.
        stationarity: |phi + beta| after the step, in metres: free and chopped gradient.
    """

    kind: StepKind
    stationarity: float


@dataclass(frozen=True)
class QPResult:
    """Answer of a Tresca problem.

    Attributes:
        x: Contact forces in newtons, this rank's part, shape (3 m,), node by node (n, t1, t2).
        gradient: A x - b in metres, shape (3 m,): remaining normal gap, and minus the slip.
        multipliers: Lagrange multipliers of the bounds and of the discs in metres, shape (m, 2).
        status: How the solver ended.
        iterations: Steps taken; `steps(kind)` counts those of one kind of KPRGP.
        products: Products by A, all of them.
        residual: Natural residual, recomputed at the end with a fresh product.
        history: One record a step.
    """

    x: FloatArray
    gradient: FloatArray
    multipliers: FloatArray
    status: Status
    iterations: int
    products: int
    residual: float
    history: tuple[QPStep, ...]

    def steps(self, kind: StepKind) -> int:
        """KPRGP's steps of a kind; 0 of path following."""
        return sum(isinstance(step, ActiveSetStep) and step.kind == kind for step in self.history)


@dataclass(frozen=True)
class OuterStep:
    """One Tresca problem of the fixed point.

    Attributes:
        iteration: Number of the Tresca problem, from 1.
        residual: Coulomb residual of its answer.
        change: |F x_n - g| / max(|F x_n|, |g|), how far the slip bound still moves.
        contraction: How much closer the map g -> F x_n(g) brings the last two g, |change of F x_n| / |change of g|;
            nan for the first.
        slope: The same along the change of g, with its sign: negative where the map overshoots; nan for the first.
        damping: The part of F x_n - g that the next g goes along, in (0, 1].
        inner_tolerance: Residual asked of the Tresca problem.
        path_following: PF steps.
        products: Products by A.
        krylov: CG iterations.
        warm: Whether the Tresca problem was solved from the last answer.
        seconds: Wall time.
    """

    iteration: int
    residual: float
    change: float
    contraction: float
    slope: float
    damping: float
    inner_tolerance: float
    path_following: int
    products: int
    krylov: int
    warm: bool
    seconds: float


@dataclass(frozen=True)
class CoulombResult:
    """Answer of a Coulomb problem.

    Attributes:
        x: Contact forces in newtons, this rank's part, shape (3 m,), node by node (n, t1, t2).
        gradient: A x - b in metres, shape (3 m,): remaining normal gap, and minus the slip.
        slip_bound: g of the last Tresca problem in newtons, shape (m,).
        status: How the solver ended.
        contraction: Measured contraction rate of the map g -> F x_n(g); nan if there were too few steps to tell.
        iterations: Tresca problems solved; 0 of the one loop.
        path_following: PF steps of all of them; Newton steps of the one loop.
        products: Products by A, all of them.
        residual: Coulomb residual, recomputed at the end with a fresh product.
        history: One record a Tresca problem; of the one loop, one a Newton step.
        method: What solved it, in words.
        message: What was seen, if it did not converge.
    """

    x: FloatArray
    gradient: FloatArray
    slip_bound: FloatArray
    status: Status
    contraction: float
    iterations: int
    path_following: int
    products: int
    residual: float
    history: tuple[OuterStep, ...] | tuple[PathFollowingStep, ...]
    method: str = "successive Tresca"
    message: str = ""


class NotConverged(RuntimeError):
    """The solver ended without an answer it can vouch for; `result` has what there is."""

    def __init__(self, message: str, result: QPResult | CoulombResult):
        super().__init__(message)
        self.result = result


@dataclass(frozen=True)
class Progress:
    """Where a solve stands, for a progress display: outer step, PF step, and the residual reached."""

    outer: int
    path_following: int
    residual: float

    def __str__(self) -> str:
        outer = f"outer {self.outer:3d}  " if self.outer else ""
        return f"{outer}path following {self.path_following:3d}  residual {self.residual:.1e}"


ProgressCallback = Callable[[Progress], bool | None]
"""Called on every rank after every step; a true answer, the same on every rank, ends the solve as INTERRUPTED."""
