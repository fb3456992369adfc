"""Results of solvers: status, answer, and a record of the steps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Literal

from ..arrays import FloatArray
from .rigid_motions import NO_MOTION, Equilibrium


class Status(Enum):
    """How a solver ended."""

    CONVERGED = "converged"
    STAGNATED = "stagnated"
    OSCILLATING = "oscillating"
    DIVERGED = "diverged"
    MAX_ITERATIONS = "max_iterations"
    INTERRUPTED = "interrupted"
    NO_EQUILIBRIUM = "no_equilibrium"
    """Proven; with any other status but CONVERGED no answer was found, and there may be one."""


Accept = Callable[..., bool]
"""Whether forces in newtons, shape (3 m,), pass the certificate of the problem they belong to; collective.

Where the problem has rigid motions, they are the second argument, shape (q,)."""


class Goal:
    """Stopping criterion: the residual is small enough, and the certificate passes.

    The natural residual measures gaps by the mean compliance of the contact nodes.  If the body is held by soft
    springs, their compliance dominates, and gaps that are large compared with the deformation are small in the
    residual: then `accept` refuses the answer, and is called again each time the residual has halved, and once more at
    the end.

    Args:
        accept: The certificate; None if only the residual decides.

    Attributes:
        tolerance: Residual to reach.
        residual: Residual below which `accept` is called next.
        refused: Whether the certificate has refused an answer.
    """

    def __init__(self, tolerance: float, accept: Accept | None):
        self.tolerance = self.residual = tolerance
        self._accept = accept
        self.refused = False
        self._reached = False

    @property
    def patience(self) -> int:
        """Path-following steps without a better residual after which the solver gives up."""
        return 5 if self.refused else 20

    def reached(self, residual: float, x: FloatArray, rigid: FloatArray | None = None) -> bool:
        """Whether to stop with the forces x and rigid motions, whose residual has been computed afresh; collective."""
        if not residual <= self.residual:
            return False
        self._reached = self._passes(x, rigid)
        if not self._reached:
            self.refused, self.residual = True, 0.5 * residual
        return self._reached

    def _passes(self, x: FloatArray, rigid: FloatArray | None) -> bool:
        if self._accept is None:
            return True
        return self._accept(x) if rigid is None or not len(rigid) else self._accept(x, rigid)

    def verdict(self, residual: float, x: FloatArray, otherwise: Status, rigid: FloatArray | None = None) -> Status:
        """The final status; CONVERGED is assigned only here; collective.

        Args:
            residual: The problem's own residual at the answer, computed afresh by the problem.
            x: The answer's forces.
            otherwise: The status if residual or certificate do not pass.
            rigid: The answer's rigid motions, shape (q,), if the problem has any.
        """
        if not residual <= self.tolerance:
            return otherwise
        return Status.CONVERGED if self._reached or self._passes(x, rigid) else otherwise

    def missed(self, residual: float) -> str:
        """Reason why an answer is not CONVERGED."""
        if self.refused and residual <= self.tolerance:
            return "below the tolerance, but the certificate fails"
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
class InteriorPointStep(QPStep):
    """One Newton step of the interior-point method, in the scaled variables of the solver.

    Attributes:
        theta: Duality measure nu^T z / (number of constraints) after the step.
        sigma: Centring.
        alpha: Step length.
        gradient: Root mean square of the weighted gradient after the step.
        krylov_tolerance: Relative tolerance of the Newton system.
    """

    theta: float
    sigma: float
    alpha: float
    gradient: float
    krylov_tolerance: float


@dataclass(frozen=True)
class SemismoothStep(QPStep):
    """One step of the semismooth Newton method.

    Attributes:
        changed: Nodes that opened, closed, stuck or slipped anew in it.
        moved: Largest change of a force in it, over the largest on its body.
    """

    changed: int
    moved: float


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
class OuterStep:
    """One Tresca problem of successive Tresca.

    Attributes:
        iteration: Number of the Tresca problem, from 1.
        residual: Coulomb residual of its answer.
        change: |r(x_n) - g| / max(|r(x_n)|, |g|), how far the slip bound still changes.
        contraction: Contraction factor of the map g -> r(x_n(g)) for the last two g, |change of r| / |change of g|;
            nan for the first.
        slope: Signed factor along the change of g: negative if the map overshoots; nan for the first.
        damping: The fraction of r(x_n) - g added to g, in (0, 1].
        inner_tolerance: Tolerance of the Tresca problem.
        path_following: Newton steps.
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


@dataclass(frozen=True, eq=False)
class SolverResult:
    """Answer of a problem with friction.

    Attributes:
        x: Contact forces in newtons, this rank's part, shape (3 m,), node by node (n, t1, t2).
        gradient: w = A x - b in metres, shape (3 m,): remaining normal gap, and minus the slip; with rigid motions A x
            - b - G^T alpha.
        slip_bound: Bound of friction of every node in newtons, shape (m,): r(x_n), or g of the last Tresca problem.
        multipliers: Lagrange multipliers of the bounds and of the discs in metres, shape (m, 2).
        status: How the solver ended.
        outer_steps: Number of Tresca problems of successive Tresca; 0 for other solvers.
        newton_steps: Newton steps of the interior-point method, over all Tresca problems.
        products: Total products by A.
        residual: Natural residual of the problem, recomputed at the end with a fresh product.
        history: One record per Newton step or step of KPRGP; for successive Tresca, one per Tresca problem.
        method: The solver's name.
        contraction: For successive Tresca, the measured factor of the map g -> r(x_n(g)); nan if not measured.
        message: What was observed, if it did not converge.
        unsettled: Largest change of a force in a Newton step from x, over the largest on its body; None if none was
            taken, since the residual says as much.
        rigid: Rigid motions alpha of the problem's bodies, shape (q,), the same on all ranks; empty without any.
        equilibrium: With the status NO_EQUILIBRIUM, which is proven, the motion that contact cannot resist, load and
            resistance; with another one the motion along which bodies slide away in the last iterate, if they do.
    """

    x: FloatArray
    gradient: FloatArray
    slip_bound: FloatArray
    multipliers: FloatArray
    status: Status
    residual: float
    method: str = ""
    outer_steps: int = 0
    newton_steps: int = 0
    products: int = 0
    history: tuple[QPStep, ...] | tuple[OuterStep, ...] = ()
    contraction: float = math.nan
    message: str = ""
    unsettled: float | None = None
    rigid: FloatArray = field(default_factory=NO_MOTION.copy)
    equilibrium: Equilibrium | None = None

    def steps(self, kind: StepKind) -> int:
        """KPRGP's steps of a kind; 0 for other solvers."""
        return sum(isinstance(step, ActiveSetStep) and step.kind == kind for step in self.history)


class NotConverged(RuntimeError):
    """The solver ended without reaching its tolerance; `result` has the best answer."""

    def __init__(self, message: str, result: SolverResult):
        super().__init__(message)
        self.result = result


@dataclass(frozen=True)
class Progress:
    """Progress of a solve, for a display: outer step, PF step, and the residual reached."""

    outer: int
    path_following: int
    residual: float

    def __str__(self) -> str:
        outer = f"outer {self.outer:3d}  " if self.outer else ""
        return f"{outer}path following {self.path_following:3d}  residual {self.residual:.1e}"


ProgressCallback = Callable[[Progress], bool | None]
"""Called on every rank after every step; a true result, the same on every rank, ends the solve as INTERRUPTED."""
