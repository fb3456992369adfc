"""The contact problem: a body, its loads and its foundations, as A, b and the law of friction for the solvers."""

from __future__ import annotations

import copy
import logging
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final, Self

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import (
    Deformable,
    Elasticity,
    Equation,
    Equations,
    HeatLoad,
    HyperelasticBody,
    JoinedBodies,
    Load,
    Materials,
    RigidFace,
    SingleBody,
    Spring,
    Support,
    Temperatures,
    ThermalLoad,
    build_bodies,
    distributed_bodies,
    rigid_faces_of_slices,
    supports_of_slices,
)
from ..fem.contact import Pretension, Tied, with_slaves
from ..fem.geometry import Amplitude, Field, RigidFoundation, same_on_all_ranks
from ..fem.meshes import JoinedMesh, NamedMesh
from ..fem.ufl_values import present_values
from ..lazy_names import late_bound
from ..linalg.compliance import LinearSolver
from ..solvers.friction_problem import Solver, contact_solver
from ..solvers.results import ProgressCallback, SolverResult
from . import notebook
from .arguments import (
    certifying,
    contacts_given,
    linear_solver_of,
    named,
    on_named_surfaces,
    on_two_sides,
    refuse_wrong,
)
from .contact import Contact
from .contact_body import ContactBody
from .contact_faces import StatePoints
from .discrete_problem import DiscreteProblem
from .equilibrium import refuse_without_equilibrium
from .heat import HeatProblem
from .heated import heated
from .input_echo import contacts_of, loads_of, ties_of
from .large_motions import LoadStepLoop
from .load_step import state_after
from .load_steps import LoadSteps
from .notebook import residuals_shown
from .probes import Probe
from .provenance import now, timed
from .small_strain import known_mode
from .solution import Solution, warn
from .solving import Solving, answer_of
from .state import State
from .stopping_criterion import CERTIFIED_FROM

_log = logging.getLogger(__name__)


def _on_curved_faces(pair: Contact, mesh: NamedMesh | JoinedMesh) -> Contact:
    """The pair with the surfaces for which its first-order facets stand, where the mesh knows them."""

    def stand_for(face: str) -> RigidFoundation | None:
        return (mesh.bodies[mesh.split(face, "contact")[0]] if isinstance(mesh, JoinedMesh) else mesh).curved

    assert pair.against is not None
    surface, against = pair.surface or stand_for(pair.face), pair.against_surface or stand_for(pair.against)
    return replace(pair, surface=surface, against_surface=against)


def _of_layer(one: Any, copies: float) -> Any:
    """What follows others, with the part of forces and stiffnesses that one of so many layers has."""
    if isinstance(one, Pretension) and one.force is not None:
        return replace(one, force=one.force / copies)
    if isinstance(one, RigidFace):
        along, about = (np.asarray(of) / copies for of in (one.translation_stiffness, one.rotation_stiffness))
        return replace(one, translation_stiffness=tuple(along), rotation_stiffness=tuple(about))
    return one


_Values = Mapping[str, list[FloatArray]]

_NOT_OF_BODIES: Final = {"contact", "heat"}
"""Arguments of which the bodies do not have the values."""

_NOT_OF_STIFFNESS: Final = {*_NOT_OF_BODIES, "clamps", "tractions", "body_force", "gravity", "temperature"}
"""Arguments on whose values K does not depend where the same directions are held."""


def _values_of(given: Mapping[str, Any]) -> _Values:
    """`present_values` of the arguments of a problem besides its mesh or body, which has its own."""
    return {name: present_values(value) for name, value in given.items() if name != "mesh"}


def _bodies_of(given: Mapping[str, Any], known: Deformable | None = None, changed: Collection[str] = ()) -> Deformable:
    """The bodies of the arguments of a problem, with what follows others; with all that is the same as of `known`
    ones, since which these arguments have other values; collective."""
    if known is not None and _NOT_OF_BODIES.issuperset(changed):
        return known
    mesh = given["mesh"]
    if isinstance(mesh, Deformable):
        body = mesh
    else:
        kind: Callable[..., SingleBody] = HyperelasticBody if given["kinematics"] == "large" else Elasticity
        heat = given["reference_temperature"], given["temperature_amplitude"]
        temperature = given["reference_temperature"] if len(given["heat"]) else given["temperature"]
        names = ("material", "clamps", "tractions", "body_force", "springs", "body_force_amplitude", "gravity")
        own: list[Any] = [given[name] for name in (*names, "gravity_amplitude")]
        own[1] = [*own[1], *supports_of_slices(mesh)]
        if isinstance(mesh, JoinedMesh):
            body = JoinedBodies(build_bodies(kind, distributed_bodies(mesh, *[*own, temperature, *heat])))
        else:
            if any(isinstance(one, Mapping) for one in (given["body_force"], given["gravity"], temperature)):
                raise ValueError("body_force, gravity, temperature: by body only for the bodies of coulomb.join")
            body = kind(mesh, *own, None if temperature is None else ThermalLoad(temperature, *heat))
    body = body.at_time(given["time"])
    equations = [one for one in given["ties"] if isinstance(one, Equation) and one.stiffness is None]
    links = [one for one in given["ties"] if isinstance(one, Equation) and one.stiffness is not None]
    ties = [one for one in given["ties"] if not isinstance(one, Equation)]
    followers = [_of_layer(one, body.copies) for one in (*rigid_faces_of_slices(mesh), *given["rigid_faces"], *ties)]
    followers += [Equations(equations)] if equations else []
    if links and given["kinematics"] == "large":
        raise ValueError(f"{links[0].what}: its stiffness is for small motions")
    if followers or links:
        links = [replace(link, stiffness=float(link.stiffness or 0.0) / body.copies) for link in links]
        body = JoinedBodies({member.name: member.body for member in body.members}, followers, given["time"], links)
    if known is not None and _NOT_OF_STIFFNESS.issuperset(changed):
        body.keep_stiffness(known)
    if given["kinematics"] != "large":
        _ = body.K  # what is wrong with supports is said before what is wrong with contacts
    return body


class ContactProblem(DiscreteProblem):
    """Linear elastic bodies in frictional contact with each other and with rigid foundations.

    u = K^-1 (f - B^T x) with the contact forces x, which obey |x_t| <= c a + F x_n (`solvers/laws.py`).

    Args:
        mesh: The body: a mesh (`NamedMesh`, or the MeshData of dolfinx.io.gmsh), with material, loads and supports as
            below; or a `Body` of the user's forms, which has its own: `ContactProblem(body, contact)`.  Several bodies:
            what `join` makes of their meshes, or of `Body`s.
        material: Its material, or a mapping of cell groups to theirs; of several bodies one for all, or a mapping of
            bodies or groups ("lower:steel") to theirs.  After a `Body`: the contact.
        clamps: Prescribed displacements (`Clamp`, `PrescribedDisplacement`); rigid motions that they and the
            springs leave free are found from the equilibrium of loads and contact forces (`NoEquilibrium`).
        contact: The contact face, its foundation or the face against it, and friction; or several, also of one face;
            their laws may differ.
        tractions: Surface loads: `Traction`, `Pressure`, `TotalForce`, `PointLoad`.
        body_force: Force per volume in N/m^3.
        springs: Elastic supports.
        body_force_amplitude: Factor of the body force as a function of time.
        gravity: Acceleration of gravity in m/s^2, for example (0, 0, -9.81); every material then needs a density.
        gravity_amplitude: Factor of gravity as a function of time.
        temperature: Temperature of the body in kelvin or degrees Celsius: a number, a function of x, a
            `NodalField`, or `NodeTemperatures` at nodes of a mesh file; every material then needs a thermal expansion.
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
            (`Pretension`); and linear equations between displacements of nodes (`Equation`).
        kinematics: "small" for small strains, or "large" for large motions; of a `Body` from an energy or a residual,
            or of a mesh with material (`NeoHookean`, ...), supports and loads.
        branch: Which equilibrium is taken in large motions: "any" that Newton's method finds, an unstable one being
            invalid, or from an unstable one along its mode to a "stable" one.

    Examples:
        A block, pressed on the floor by 1 MPa on its top: the contact forces bear it.

        >>> import coulomb
        >>> mesh = coulomb.box((0.1, 0.1, 0.05), (4, 4, 2))  # metres
        >>> problem = coulomb.ContactProblem(
        ...     mesh,
        ...     coulomb.Material(young=2.1e11, poisson=0.3),
        ...     clamps=[],
        ...     contact=coulomb.Contact("bottom", friction=0.3),
        ...     tractions=[coulomb.Pressure("top", 1e6)],
        ... )
        >>> solution = problem.solve()
        >>> print(solution.valid, solution.force_on_body[:, 2].sum().round(3))  # newtons
        True 10000.0

    Attributes:
        body: The time-independent part: K, K^-1, A, contact faces and foundations.
        state: The state at one time: loads, gaps, frames, law of friction, slip origin.
        large: What the load steps of large motions share; None of small strains.
        given: The arguments by name.
        Others: As of `DiscreteProblem`.

    Raises:
        ValueError: On every rank, if the input is invalid, with a remedy.
    """

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
        temperature: Temperatures | Mapping[str, Temperatures] | None = None,
        reference_temperature: float = 0.0,
        temperature_amplitude: Amplitude = 1.0,
        heat: Sequence[HeatLoad] = (),
        time: float = 0.0,
        linear_solver: LinearSolver | str | None = None,
        explicit: bool | None = None,
        small_strain: str = "enforce",
        probes: Sequence[Probe] = (),
        kinematics: str = "small",
        branch: str = "any",
        ties: Sequence[Tied | Equation] = (),
        rigid_faces: Sequence[RigidFace] = (),
    ):
        mesh = named(mesh)
        given = {name: value for name, value in locals().items() if name not in ("self", "__class__")}
        refuse_wrong(given)
        self._pose(given, None, ())

    def _pose(self, given: Mapping[str, Any], known: ContactBody | None, changed: Collection[str]) -> None:
        """Take these arguments, with all that is the same as of a known body, since which they have other values;
        collective."""
        mode, started, time, large = (
            known_mode(given["small_strain"]),
            now(),
            given["time"],
            given["kinematics"] == "large",
        )
        as_given = contacts_given(given)
        mesh, contacts = on_two_sides(given["mesh"], as_given, large)
        given, methods = {**given, "mesh": mesh}, (linear_solver_of(given["linear_solver"]), given["explicit"])
        known = None if large else known
        before = None if known is None else known.elasticity.at_time(time)
        make = partial(_bodies_of, given, before, changed)
        body = ContactBody(make, given["mesh"].comm, contacts, time, *methods, given["probes"])
        if known is not None:
            body.keep_stiffness(known)
        if len(given["heat"]):
            body.heat = HeatProblem(body.elasticity, given["heat"], body.contacts, given["reference_temperature"])
        for text in body.remarks if body.comm.rank == 0 else ():
            _log.warning("%s", text)
        with timed(body.seconds, "assembly"):
            state = body.state(time)
        super().__init__(body, state, mode, started, body.seconds)
        self.given, self._values = given, _values_of(given)
        self._latest: ContactProblem = self
        itself = {k: one.face for k, one in enumerate(as_given) if one.face == one.against}
        self.large = LoadSteps(body, time, *methods, given["branch"], itself) if large else None
        self.contacts = self.large.contacts if self.large else body.contacts

    def at(self, time: float, before: State | None = None) -> ContactProblem:
        """The problem at another time with the same body, K^-1 and A; collective.

        Args:
            time: The time.
            before: State after the load step before, from which slip is measured, moved with the foundation since;
                by default slip is measured from the undeformed body.

        Raises:
            ValueError: On every rank, if an amplitude or the motion has no value then, or the set of contact
                nodes changes.
        """
        refuse_wrong({"mesh": self.made_of, "time": time})
        if (there := self._renewed()) is not self:
            return there.at(time, before)
        seconds: dict[str, float] = {}
        if self.large is not None:
            there = copy.copy(self)
            there.time, there.before, there.seconds = time, before, seconds
            return there
        with timed(seconds, "assembly"):
            body = self.body.at_time(time)
            state = body.state(time, before)
        return self.in_state(state, seconds, before, body)

    def _renewed(self) -> ContactProblem:
        """Itself, or the same problem made anew if functions or constants of DOLFINx among its arguments have other
        values since; collective."""
        now = _values_of(self.given)

        def changed(values: _Values) -> list[str]:
            other = np.array([not all(map(np.array_equal, values[name], now[name])) for name in now], dtype=np.int64)
            ranks = self.comm.allreduce(other)
            return [name for name, count in zip(now, ranks, strict=True) if count]

        if not changed(self._values):
            return self
        if since := changed(self._latest._values):
            there = copy.copy(self)
            there._pose({**self.given, "time": self.time}, self._latest.body, since)
            self._latest = there
        return self._latest

    @property
    def made_of(self) -> NamedMesh | JoinedMesh | Deformable:
        """Its first argument, of a mesh with the surfaces that contacts and supports name (`NamedMesh.surfaces`)."""
        return on_named_surfaces(self.given["mesh"], self.body.contacts, self.given.get("clamps", ()))

    def on(self, mesh: NamedMesh | JoinedMesh | Deformable) -> Self:
        """The same problem on another mesh (or another `Body`), at the same time, with contact points of pairs and tied
        nodes on the same faces; ValueError on every rank if that has not the faces and groups of cells; collective."""
        given = dict(self.given)
        given |= {"material": None} if isinstance(self.made_of, Deformable) else {}  # it may be the contact
        pairs = zip(contacts_given(self.given), self.body.contacts, strict=True)
        contacts = [
            as_given if as_given.face == as_given.against else replace(one, slave=one.against is not None)
            for as_given, one in pairs
        ]
        if given["kinematics"] == "small" and not isinstance(mesh, Deformable):
            contacts = [contact if contact.against is None else _on_curved_faces(contact, mesh) for contact in contacts]
        given["ties"] = with_slaves(given["ties"], self.elasticity.constraints.as_made)
        return type(self)(**{**given, "mesh": mesh, "contact": contacts, "time": self.time})

    @property
    def points_of_states(self) -> StatePoints:
        """The contact points of the states of a load history: in large motions all nodes of the contact faces, since
        which of them are contact points depends on the displacement, and so where supports or ties begin or end."""
        return self.body.points_of_states(self.surface) if self.large is None else self.large.points

    def refuse_wrong_supports(self, times: Sequence[float] = ()) -> None:
        """Refuse supports that hold nodes of contact faces inside foundations now, or at other times; ValueError on
        every rank, with face, number of nodes and depth; collective.

        Where supports have begun, only the load step before says what they prescribe.
        """
        for time in times or (self.time,):
            if times and self.elasticity.depends_on_steps(time):
                continue
            body, loading = self.elasticity, self.loading
            if times or self.large is not None:
                body = self.body.elasticity.at_time(time)
                loading = body.at(time)
            self.body.refuse_wrong_supports(body, loading, exact=self.large is not None)

    def starts(self, before: State) -> FloatArray | None:
        """Forces in newtons to start a load step from: those of the state before in the present frames, and these
        extrapolated in time, shapes (3 m,); None in the first one."""
        if before.number == 0 or self.large is not None:
            return None
        forces = [before.force_on_body]
        if before.before is not None:
            ahead = (self.time - before.time) / (before.time - before.before.time)
            forces.append(before.force_on_body + ahead * (before.force_on_body - before.before.force_on_body))
        places = self.body.places(self.surface)
        return np.array([-self.surface.force_components(force[places]).ravel() for force in forces])

    def after(self, before: State, solution: Solution) -> State:
        """The state after a load step; collective."""
        if self.large is not None:
            return LoadStepLoop(self, self.large).after(before, solution)
        return state_after(before, solution)

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
        outdated = self.large is None and self.elasticity.outdated(self.loading)
        if outdated or self._renewed() is not self:
            return self.at(self.time, self.before).solve(tolerance, solver, progress, start)
        self.refuse_wrong_supports()
        if self.large is not None:
            return LoadStepLoop(self, self.large).solve(tolerance, solver, progress)
        refuse_without_equilibrium(self)
        heat = self.body.heat
        if heat is not None:  # a solver that starts within its tolerance would leave a certificate that fails as it is
            tolerance, solver = min(tolerance, CERTIFIED_FROM), certifying(solver)
        with residuals_shown(progress, tolerance, self.comm.rank) as shown:
            solving = Solving(tolerance, solver, shown)
            answer = solving.in_place(self, start) if heat is None else heated(self, heat, solving, start)
        warn(answer)
        return answer

    def solution(self, result: SolverResult) -> Solution:
        """Displacement and certificate of a solver's result, converged or not; in large motions those of the state
        before the step, with the loads of its end; collective."""
        return answer_of(self, result) if self.large is None else LoadStepLoop(self, self.large).solution(result)

    def refine(self, to: float, totals: Sequence[str] = (), unknowns: int = 300_000) -> Any:
        """Solve on finer and finer meshes until the error bars of some totals are at most `to` of them, as 0.02:
        arguments and errors as of `io.refinement.refine`."""
        return late_bound["refine"](self, to, totals, unknowns)

    def _repr_html_(self) -> str:
        """Bodies, loads, supports and contacts as they were understood; on several ranks the size alone."""
        bodies, sizes = self.elasticity.members, self.body.unknowns
        unknowns = ", ".join(f"{count} {what}" for what, count in sizes.items())
        size = notebook.verdict(True, f"contact problem: {unknowns} unknowns")
        if self.comm.size > 1:
            return size
        rows = [(body.name or "the body", body.body.numbering.total, body.body.degree) for body in bodies]
        loads = [(one.what, _vector(one.force), _vector(one.moment)) for one in loads_of(self, [self.time])]
        supports = [(one["kind"], one["face"], one["holds"]) for one in self.elasticity.support_entries()]
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


def _vector(values: FloatArray) -> str:
    return f"({', '.join(f'{value:.4g}' for value in values)})"


LargeMotions = partial(ContactProblem, kinematics="large")
"""`ContactProblem` of large motions."""
