"""The contact problem: a body, its loads and its foundations, as A, b and the law of friction for the solvers."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any, ClassVar, Final, Self, cast

import numpy as np
from threadpoolctl import threadpool_limits

from ..arrays import FloatArray
from ..fem.bodies import (
    Deformable,
    Elasticity,
    HeatLoad,
    JoinedBodies,
    Load,
    Materials,
    SingleBody,
    Spring,
    Support,
    ThermalLoad,
    build_bodies,
    distributed_bodies,
    vanishes,
)
from ..fem.contact import ContactSurface, RigidFace, Tied, TiedBodies, with_slaves
from ..fem.geometry import Amplitude, Coefficient, Field, RigidFoundation, same_on_all_ranks
from ..fem.meshes import JoinedMesh, NamedMesh
from ..lazy_names import late_bound
from ..linalg.compliance import IterativeSolver, LinearSolver
from ..linalg.reductions import Reductions
from ..linalg.solve_errors import CGNotConverged, TooSlow
from ..native import threads
from ..solvers.automatic import Automatic
from ..solvers.friction_problem import Solver, contact_solver
from ..solvers.interior_point import InteriorPoint
from ..solvers.results import NotConverged, ProgressCallback, SolverResult, Status
from . import notebook
from .arguments import certifying, contacts_given, linear_solver_of, refuse_wrong
from .contact import Contact
from .contact_body import ContactBody
from .discrete_problem import CountedProgress, DiscreteProblem, linear_solve_failed
from .equilibrium import refuse_without_equilibrium
from .heat import UNBALANCED, Heat, HeatProblem
from .input_echo import contacts_of, loads_of, supports_of, ties_of
from .linear_problem import Before, ContactState
from .load_step import State
from .notebook import residuals_shown
from .probes import Probe
from .provenance import now, timed
from .small_strain import known_mode
from .solution import Solution, warn
from .stopping_criterion import CERTIFIED_FROM, StoppingCriterion

_log = logging.getLogger(__name__)

KINEMATICS = ("small", "large")
"""Theories of a problem."""

AGREEMENT: Final = 1e-9
"""Change of temperature in a round, over the largest, at which contact and heat agree."""

SHORTEST, LONGEST = 0.1, 3.0
"""Bounds of the factor by which the change of temperature of a round is taken (Aitken)."""

ROUNDS: Final = 50
"""Maximum number of rounds of contact and conduction."""

_POSITIONAL = ("mesh", "material", "clamps", "contact", "tractions", "body_force", "springs")


def _on_curved_faces(pair: Contact, mesh: NamedMesh | JoinedMesh) -> Contact:
    """The pair with the surfaces for which its first-order facets stand, where the mesh knows them."""

    def stand_for(face: str) -> RigidFoundation | None:
        return (mesh.bodies[mesh.split(face, "contact")[0]] if isinstance(mesh, JoinedMesh) else mesh).curved

    assert pair.against is not None
    surface, against = pair.surface or stand_for(pair.face), pair.against_surface or stand_for(pair.against)
    return replace(pair, surface=surface, against_surface=against)


class HeatNotConverged(NotConverged):
    """Contact and heat do not agree, or nothing fixes the temperature of a body."""


class ContactProblem(DiscreteProblem):
    """Linear elastic bodies in frictional contact with each other and with rigid foundations.

    u = K^-1 (f - B^T x) with the contact forces x, which obey |x_t| <= c a + F x_n (`solvers/laws.py`).

    Args:
        mesh: The body: a mesh, with material, loads and supports as below; or a `Body` of the user's forms, which has
            its own: `ContactProblem(body, contact)`.  Several bodies: what `join` makes of their meshes, or of `Body`s.
        material: Its material, or a mapping of cell groups to theirs; of several bodies one for all, or a mapping of
            bodies or groups ("lower:steel") to theirs.  After a `Body`: the contact.
        clamps: Prescribed displacements (`Clamp`, `PrescribedDisplacement`); rigid motions that they and the
            springs leave free are found from the equilibrium of loads and contact forces (`NoEquilibrium`).
        contact: The contact face, its foundation or the face against it, and friction; or several, which share no node;
            their laws may differ.
        tractions: Surface loads: `Traction`, `Pressure`, `TotalForce`, `PointLoad`.
        body_force: Force per volume in N/m^3.
        springs: Elastic supports.
        body_force_amplitude: Factor of the body force as a function of time.
        gravity: Acceleration of gravity in m/s^2, for example (0, 0, -9.81); every material then needs a density.
        gravity_amplitude: Factor of gravity as a function of time.
        temperature: Temperature of the body in kelvin or degrees Celsius: a number, a function of x, or a
            `NodalField`; every material then needs a thermal expansion.
        reference_temperature: Temperature of the unstrained body, in the same unit.
        temperature_amplitude: Factor of the difference of the two as a function of time.
        heat: In place of a temperature, what heats and cools the bodies (`HeatLoad`): the temperature follows from
            steady conduction, which needs the conductivity and the thermal expansion of every material, and contact and
            conduction are solved in turn until both agree.
        time: Time of loads, prescribed displacements and the foundation's position.
        linear_solver: DirectSolver ("direct") or IterativeSolver ("iterative") for K^-1; by default ("auto")
            chosen by size.
        explicit: Whether to form the matrix A; by default chosen by size.  Needs the direct solver.
        small_strain: Whether an answer outside the theory (`SmallStrain.violations`) does not count, "enforce", or
            causes a warning, "warn".
        probes: Points at which displacement, slip and pressure are reported: `Solution.probes`, summary.json and
            history.csv.
        rigid_faces: Faces that move as rigid bodies, with a reference point each.
        ties: Faces that are glued to each other (`Tied`), cuts of a sector (`CyclicSymmetry`), and sections of bolts
            (`Pretension`).
        kinematics: "small" for small strains, or "large" for large motions (`coulomb.kinematics.LargeMotions`).

    Attributes:
        body: The time-independent part: K, K^-1, A, contact faces and foundations.
        state: The state at one time: loads, gaps, frames, law of friction, slip origin.
        silent: Whether remarks and small-strain warnings are not logged.
        Others: As of `DiscreteProblem`.

    Raises:
        ValueError: On every rank, if the input is invalid, with a remedy.
    """

    silent: ClassVar[bool] = False
    _of_meshes: ClassVar[Callable[..., SingleBody]] = Elasticity
    _given: tuple[tuple[Any, ...], dict[str, Any]]

    def __new__(cls, *arguments: Any, kinematics: str = "small", **others: Any) -> Self:
        if kinematics not in KINEMATICS:
            raise ValueError(f'kinematics must be "small" or "large", but is {kinematics!r}')
        kind = late_bound["large"]() if kinematics == "large" and cls is ContactProblem else cls
        problem = cast(Self, object.__new__(kind))
        problem._given = arguments, {**others, "kinematics": kinematics}
        return problem

    def __init__(
        self,
        mesh: NamedMesh | JoinedMesh | Deformable,
        material: Materials | Contact | Sequence[Contact] | None = None,
        clamps: Sequence[Support] = (),
        contact: Contact | Sequence[Contact] | None = None,
        tractions: Sequence[Load] = (),
        body_force: Field | Mapping[str, Field] = (0.0, 0.0, 0.0),
        springs: Sequence[Spring] = (),
        *,
        body_force_amplitude: Amplitude = 1.0,
        gravity: Sequence[float] | Mapping[str, Sequence[float]] = (0.0, 0.0, 0.0),
        gravity_amplitude: Amplitude = 1.0,
        temperature: Coefficient | Mapping[str, Coefficient] | None = None,
        reference_temperature: float = 0.0,
        temperature_amplitude: Amplitude = 1.0,
        heat: Sequence[HeatLoad] = (),
        time: float = 0.0,
        linear_solver: LinearSolver | str | None = None,
        explicit: bool | None = None,
        small_strain: str = "enforce",
        probes: Sequence[Probe] = (),
        kinematics: str = "small",
        ties: Sequence[Tied] = (),
        rigid_faces: Sequence[RigidFace] = (),
    ):
        refuse_wrong(mesh, {**self._named, "time": time, "explicit": explicit, "probes": probes})
        mode, started = known_mode(small_strain), now()
        given: object = contact
        if len(heat):
            if temperature is not None:
                raise ValueError("heat: the temperature follows from heat: give heat or temperature, one of the two")
            temperature = reference_temperature
        if isinstance(mesh, Deformable):
            own = (clamps, tractions, springs)
            if (
                temperature is not None
                or any(not isinstance(one, Sequence) or len(one) for one in own)
                or any(isinstance(one, Mapping) or not vanishes(one) for one in (body_force, gravity))
            ):
                raise ValueError("a body has its own loads and supports: give ContactProblem(body, contact) no others")
            if (material is None) == (contact is None):
                raise ValueError("a body has its own material: ContactProblem(body, contact)")
            given = material if contact is None else contact
        elif material is None or isinstance(material, Contact) or contact is None:
            raise ValueError("give ContactProblem(mesh, material, clamps, contact), or ContactProblem(body, contact)")

        def make() -> Deformable:
            if isinstance(mesh, Deformable):
                return mesh.at_time(time)
            arguments = (cast(Materials, material), clamps, tractions)
            if isinstance(mesh, JoinedMesh):
                bodies = distributed_bodies(
                    *(mesh, *arguments, body_force, springs, body_force_amplitude, gravity, gravity_amplitude),
                    *(temperature, reference_temperature, temperature_amplitude),
                )
                return JoinedBodies(build_bodies(self._of_meshes, bodies))
            if isinstance(body_force, Mapping) or isinstance(gravity, Mapping) or isinstance(temperature, Mapping):
                raise ValueError("body_force, gravity, temperature: by body only for the bodies of coulomb.join")
            thermal = None
            if temperature is not None:
                thermal = ThermalLoad(temperature, reference_temperature, temperature_amplitude)
            return self._of_meshes(
                *(mesh, *arguments, body_force, springs, body_force_amplitude, gravity, gravity_amplitude, thermal)
            )

        def make_tied() -> Deformable:
            body = make()
            return TiedBodies(body, [*rigid_faces, *ties], time) if ties or rigid_faces else body

        body = ContactBody(
            make_tied, mesh.comm, self._contacts_of(given), time, linear_solver_of(linear_solver), explicit, probes
        )
        if len(heat):
            body.heat = HeatProblem(body.elasticity, heat, body.contacts, reference_temperature)
        for text in body.remarks if not self.silent and body.comm.rank == 0 else ():
            _log.warning("%s", text)
        with timed(body.seconds, "assembly"):
            state = body.state(time)
        super().__init__(body, state, mode, started, body.seconds)

    def _contacts_of(self, given: object) -> tuple[Contact, ...]:
        """One contact or several, as a tuple."""
        return contacts_given(given)

    def at(self, time: float, before: Before | None = None) -> ContactProblem:
        """The problem at another time with the same body, K^-1 and A; collective.

        Args:
            time: The time.
            before: State after the load step before, from which slip is measured, moved with the foundation since;
                by default slip is measured from the undeformed body.

        Raises:
            ValueError: On every rank, if an amplitude or the motion has no value then, or the set of contact
                nodes changes.
        """
        refuse_wrong(self.made_of, {"time": time})
        seconds: dict[str, float] = {}
        with timed(seconds, "assembly"):
            state = self.body.state(time, before)
        return self.in_state(state, seconds, before)

    @property
    def _named(self) -> dict[str, Any]:
        """The arguments by name."""
        return {**dict(zip(_POSITIONAL, self._given[0], strict=False)), **self._given[1]}

    @property
    def made_of(self) -> NamedMesh | JoinedMesh | Deformable:
        """Its first argument."""
        return cast(NamedMesh | JoinedMesh | Deformable, self._named["mesh"])

    def on(self, mesh: NamedMesh | JoinedMesh | Deformable) -> Self:
        """The same problem on another mesh (or another `Body`), at the same time, with contact points of pairs and tied
        nodes on the same faces; ValueError on every rank if that has not the faces and groups of cells; collective."""
        given = self._named
        given |= {"material": None} if isinstance(self.made_of, Deformable) else {}  # it may be the contact
        contacts = [replace(one, slave=one.against is not None) for one in self.body.contacts]
        if given["kinematics"] == "small" and not isinstance(mesh, Deformable):
            contacts = [one if one.against is None else _on_curved_faces(one, mesh) for one in contacts]
        given["ties"] = with_slaves(given.get("ties", ()), self.elasticity.ties)
        return type(self)(**{**given, "mesh": mesh, "contact": contacts, "time": self.time})

    def in_state(
        self,
        state: ContactState,
        seconds: dict[str, float] | None = None,
        before: Before | None = None,
    ) -> Self:
        """The problem of the same body in another state; `seconds` and `before` as of `DiscreteProblem`."""
        problem = type(self).__new__(type(self))  # __init__ makes the body
        problem._given = self._given
        DiscreteProblem.__init__(
            *(problem, self.body, state, self.small_strain, self.started),
            *({} if seconds is None else seconds, before),
        )
        return problem

    def starts(self, before: State) -> FloatArray | None:
        """Forces in newtons to start a load step from: those of the state before in the present frames, and these
        extrapolated in time, shapes (3 m,); None in the first one."""
        if before.number == 0:
            return None
        forces = [before.force_on_body]
        if before.before is not None:
            ahead = (self.time - before.time) / (before.time - before.before.time)
            forces.append(before.force_on_body + ahead * (before.force_on_body - before.before.force_on_body))
        return np.array([-self.surface.force_components(one).ravel() for one in forces])

    def after(self, before: State, solution: Solution) -> State:
        """The state after a load step; collective."""
        return before.after(solution)

    def solve(
        self,
        tolerance: float = 1e-8,
        solver: Solver | None = None,
        progress: ProgressCallback | None = None,
        start: FloatArray | None = None,
    ) -> Solution:
        """Solve, and certify the answer; `Solution.valid` is the verdict.  Violations of the small-strain theory are
        logged.

        Args:
            tolerance: Residual of the problem at which to stop, once the certificate passes; a
                tolerance above 1e-8 ends the solver whether or not the certificate passes.
            solver: Replaces the default (and its tolerance): Automatic (the default), InteriorPoint or
                SuccessiveTresca; where no friction grows with pressure, also KPRGP.  Condensed Newton systems need
                explicit=False.
            progress: Called after every step; in a notebook a bar by default.
            start: Forces in newtons to start from, shape (3 m,), as those of a load step before, or of a coarser mesh
                (`interpolated_forces`).

        Raises:
            NoEquilibrium: If no contact forces balance the loads on a body that contact alone holds.
            NotConverged: If the residual stays above the tolerance, or the certificate fails for any residual
                reached; `solution(error.result)` is the best answer.  Also if K u = f is not solved by multigrid, and
                if contact and heat do not agree (`HeatNotConverged`).
        """
        same_on_all_ranks({"tolerance": tolerance, "solver": solver}, self.comm)
        solver = contact_solver(solver)
        if not (progress is None or callable(progress)):
            raise ValueError(f"progress must be a function of a step, or None, but is {progress!r}")
        if self.elasticity.outdated(self.loading):
            return self.at(self.time, self.before).solve(tolerance, solver, progress, start)
        self.refuse_held_inside()
        refuse_without_equilibrium(self)
        heat = self.body.heat
        if heat is not None:  # a solver that starts within its tolerance would leave a certificate that fails as it is
            tolerance, solver = min(tolerance, CERTIFIED_FROM), certifying(solver)
        with residuals_shown(progress, tolerance, self.comm.rank) as shown:

            def by_any_method(posed: ContactProblem, start: FloatArray | None) -> Solution:
                while True:
                    try:
                        return posed._solved(tolerance, solver, shown, start)
                    except TooSlow as slow:
                        self.body.stiffness.change_method(str(slow), condense=solver is None)
                    except NotConverged as failure:
                        ended = failure.result.status in (Status.INTERRUPTED, Status.NO_EQUILIBRIUM)
                        condense = solver is None and not self.body.stiffness.explicit
                        if ended or not self.body.stiffness.change_method(failure.result.message, condense):
                            failure.args = (f"{failure}{'' if ended else self.body.stiffness.advice}",)
                            raise

            answer = by_any_method(self, start) if heat is None else self._heated(heat, by_any_method, start)
        if not self.silent:
            warn(answer)
        return answer

    def refine(self, to: float, totals: Sequence[str] = (), unknowns: int = 300_000) -> Any:
        """Solve on finer and finer meshes until the error bars of some totals are at most `to` of them, as 0.02:
        arguments and errors as of `io.refinement.refine`."""
        return late_bound["refine"](self, to, totals, unknowns)

    def _heated(
        self,
        heat: HeatProblem,
        solved: Callable[[ContactProblem, FloatArray | None], Solution],
        start: FloatArray | None,
    ) -> Solution:
        """The answer with the temperature that it causes itself: contact and conduction are solved in turn, from the
        temperature of the load step before."""

        def at(change: FloatArray, flows: Heat | None = None) -> ContactProblem:
            loading = self.elasticity.heated(self.loading, change)
            return self.in_state(replace(self.state, loading=loading, heat=flows), self.seconds, self.before)

        over, factor, step = Reductions(self.comm), 1.0, None
        change: FloatArray = np.zeros(len(self.elasticity.x))
        if isinstance(self.before, State) and self.before.temperature_change is not None:
            change = self.before.temperature_change
        answer, apart = solved(at(change), start), np.inf
        steps, products = answer.result.newton_steps, answer.result.products
        for rounds in range(1, ROUNDS + 1):
            try:
                found = heat.solve(*at_contact(answer), change)
            except ValueError as error:
                raise HeatNotConverged(str(error), replace(answer.result, status=Status.STAGNATED)) from None
            apart = float(over.max(np.abs(found - change)) / (over.max(np.abs(found)) or 1.0))
            if apart <= AGREEMENT:
                last = at(found).solution(answer.result)
                flows = heat.flows(*at_contact(last), found)
                loose = not answer.certificate.passed  # the solver was not asked for it
                if (last.certificate.passed or loose) and flows.balanced:
                    whole = replace(last.result, newton_steps=steps, products=products)  # of all rounds
                    posed = at(found, replace(flows, rounds=rounds, agreement=apart))
                    return replace(last, problem=posed, result=whole)
            if step is not None:  # Aitken's relaxation
                turn = found - change - step
                factor *= -over.dot(step, turn) / (over.dot(turn, turn) or 1.0)
                factor = min(max(factor, SHORTEST), LONGEST)
            step = found - change
            change = change + factor * step
            answer = solved(at(change), answer.contact_force)
            steps, products = steps + answer.result.newton_steps, products + answer.result.products
        missing = heat.flows(*at_contact(answer), change).imbalance
        raise HeatNotConverged(
            f"contact and heat do not agree after {ROUNDS} rounds: the temperature changes by {apart:.1e} of itself, "
            f"and {missing:.1e} W of heat are missing; what may help: smaller load steps, or a smaller conductance, or "
            "one that depends on pressure",
            replace(answer.result, status=Status.STAGNATED),
        )

    def _repr_html_(self) -> str:
        """Bodies, loads, supports and contacts as they were understood; on several ranks the size alone."""
        bodies, sizes = self.elasticity.members, self.body.unknowns
        unknowns = ", ".join(f"{count} {what}" for what, count in sizes.items())
        size = notebook.verdict(True, f"contact problem: {unknowns} unknowns")
        if self.comm.size > 1:
            return size
        rows = [(one.name or "the body", one.body.numbering.total, one.body.degree) for one in bodies]
        loads = [(one.what, _vector(one.force), _vector(one.moment)) for one in loads_of(self, [self.time])]
        supports = [(one["kind"], one["face"], one["holds"]) for one in supports_of(self)]
        contacts = [(one["face"], one["foundation"], one["nodes"], one["law"]) for one in contacts_of(self)]
        ties = [(one["face"], one["against"], one["nodes"]) for one in ties_of(self)]
        return "".join(
            [
                size,
                notebook.table(("body", "nodes", "order"), rows),
                notebook.table(("load", "force (N)", "moment about the origin (N m)"), loads),
                notebook.table(("support", "face", "holds"), supports),
                notebook.table(("contact face", "against", "contact points", "law"), contacts),
                *([notebook.table(("tied face", "to", "nodes"), ties)] if ties else []),
            ]
        )

    def _solved(
        self, tolerance: float, solver: Solver | None, progress: ProgressCallback | None, start: FloatArray | None
    ) -> Solution:
        """The answer by the present method for K^-1; arguments and errors as of `solve`."""
        chosen = solver or self._default(tolerance)
        criterion, counted = StoppingCriterion(self), CountedProgress(progress, self.comm)
        with self.body.stiffness.limited(self.stiffness.solver):
            problem = self.friction_problem  # K^-1, A and b are timed separately
            self.linear.prepare_products()
            if chosen.tolerance <= CERTIFIED_FROM:
                problem = replace(problem, accept=criterion, balanced=criterion.gradient)
            limit = nullcontext() if solver else self.body.stiffness.few_products(self.A)
            with timed(self.seconds, "solve"), self._one_blas_thread(), limit:
                try:
                    result = chosen.solve(problem, start, progress=counted)
                except NotConverged as failure:
                    raise criterion.explained(failure, chosen.tolerance) from None
                except CGNotConverged as failure:
                    raise linear_solve_failed(self, problem, failure, counted, type(chosen).__name__) from None
        return self.solution(result, criterion)

    def _default(self, tolerance: float) -> Solver:
        """The solver where the user chooses none."""
        newton = self.body.stiffness.present.newton
        return Automatic(tolerance) if newton is None else InteriorPoint(tolerance, newton=newton())

    def solution(self, result: SolverResult, criterion: StoppingCriterion | None = None) -> Solution:
        """Displacement and certificate of a solver's result, converged or not; from `criterion` if it has them.  The
        certificate fails where heat is a part of the problem, and was not solved with contact."""
        judged = (criterion or StoppingCriterion(self)).answer(result.x, result.rigid)
        x = judged.contact_force
        law = self.slip_bound(x)
        g = np.where(law > 0.0, result.slip_bound, 0.0)  # exactly zero at open nodes, as the forces
        g = np.where(x[0::3] != result.x[0::3], law, g)  # where `zero_open_forces` has changed the normal force
        certificate = judged.certificate
        if self.body.heat is not None and result.status is not Status.CONVERGED:
            certificate = replace(certificate, checks=(*certificate.checks, UNBALANCED))
        methods = {"solver": result.method, **self.linear.methods}
        return Solution(
            *(self, x, judged.displacement, g, result, certificate, judged.evidence),
            *(self.compliances, self.mean_compliance, methods),
        )

    def _one_blas_thread(self) -> AbstractContextManager[object]:
        """One thread of BLAS where multigrid's kernels have several: OpenBLAS waits for its next call in busy loops."""
        threaded = self.body.stiffness.linear_solver is IterativeSolver and threads() > 1
        return threadpool_limits(limits=1, user_api="blas") if threaded else nullcontext()


def at_contact(answer: Solution) -> tuple[ContactSurface, float, FloatArray, FloatArray]:
    """What conduction takes of an answer: contact points, time, pressures in pascals and the power of friction in
    watts, shapes (m,); without load steps it has none."""
    nodes, problem = answer.at_nodes, answer.problem
    work = (nodes.accumulated.friction_work - nodes.earlier.friction_work) * nodes.area
    power = np.zeros_like(work) if problem.before is None else work / (problem.time - problem.before.time)
    return problem.surface, problem.time, nodes.pressure, power


def _vector(values: FloatArray) -> str:
    return f"({', '.join(f'{value:.4g}' for value in values)})"
