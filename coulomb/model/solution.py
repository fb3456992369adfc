"""The answer of a contact problem."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import FloatArray
from ..contact_fields import side_names
from ..fem.contact import face_samples
from ..lazy_names import late_bound
from ..linalg.reductions import Reductions
from ..solvers.results import SolverResult
from . import notebook
from .answer_functions import AnswerFunctions
from .certificate import Certificate, Evidence
from .certificate_scales import deformations, face_scales, rounding_forces
from .contact_body import ContactBody
from .discrete_problem import DiscreteProblem
from .face_answer import FaceAnswer
from .force_balance import force_balance
from .foundation_load import motions_of, on_foundations
from .gradient import Gradient, gradient
from .heat import Heat
from .nodal_answer import NodalAnswer
from .probes import LocatedProbes, Probe, ProbeValue
from .resultants import BoltForce, ForceBalance, Resultant, RigidFaceMotion
from .sensitivity import Posed, Sensitivity, sensitivities
from .small_strain import SmallStrain, small_strain
from .stability import Stability

_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False, repr=False)
class Solution:
    """Answer of a contact problem.

    Attributes:
        problem: What was solved.
        contact_force: x in newtons, this rank's part, shape (3 m,), node by node (n, t1, t2); x_n >= 0 presses.
        displacement: In metres, this rank's nodes, shape (k, 3).
        slip_bound: The g in newtons that the solver used, shape (m,).
        result: Status, residual and counts of the solver.
        certificate: Certificate for the equations of small strains, or of large motions.
        evidence: What the certificate was judged by.
        compliances: diag(A) of every contact point, of both tangents the mean, metres per newton, shape (m, 3).
        mean_compliance: Mean of diag(A) in metres per newton: the scale of the certificate.
        methods: By which the answer was found: the entry `method` of summary.json.
        residuals: In large motions the largest value of the certificate's checks before each linear problem, and at the
            end.

    In large motions `problem` is the last linear problem, of the bodies at their deformed place, in whose frames the
    contact forces are; slip is that of the load step, and `result` that of all linear problems together.
    """

    problem: DiscreteProblem
    contact_force: FloatArray
    displacement: FloatArray
    slip_bound: FloatArray
    result: SolverResult
    certificate: Certificate
    evidence: Evidence
    compliances: FloatArray
    mean_compliance: float
    methods: dict[str, Any]
    residuals: tuple[float, ...] = ()

    @property
    def time(self) -> float:
        """In seconds."""
        return self.problem.time

    @property
    def outer_iterations(self) -> int:
        """Number of linear problems."""
        return max(len(self.residuals) - 1, 1)

    @property
    def change(self) -> FloatArray:
        """The displacement in metres from the place at which gaps are measured, shape (k, 3)."""
        return np.zeros_like(self.displacement) if self.problem.body.undeformed else self.displacement

    @property
    def function(self) -> Any:
        """The displacement in metres as a DOLFINx Function, of the only body; of a `Body` in the user's own space.

        `solution.function("pressure")` is a field of contact.xdmf as a Function on the same mesh: numbers in the
        Lagrange space of the order of the body, vectors in that of the displacement; zero off the contact faces, where
        the status is 3.  Also "traction", the whole one on the body in pascals, and "displacement" itself.  It is the
        same object at each access.

        Raises:
            ValueError: If there are several bodies, see `functions`; if there is no field of this name.
        """
        _ = self.problem.elasticity.alone
        return self.functions[""]

    @property
    def functions(self) -> dict[str, Any]:
        """The displacement of each body by the body's name, as `function`: `solution.functions["upper"]("pressure")`;
        the name of a body that is alone is ""."""
        return self._functions.of_bodies

    @cached_property
    def _functions(self) -> AnswerFunctions:
        return AnswerFunctions(self.problem, self.displacement, lambda: late_bound["fields_on_bodies"](self))

    @cached_property
    def forces(self) -> dict[str, Any]:
        """The totals of contact in newtons, newton metres, metres, m^2, Pa and J, by name: "force" and "moment" on the
        body, "normal_force", "friction_force", "contact_area", "centre_of_pressure", "greatest_slip",
        "greatest_pressure", "dissipated_energy"; of several contacts by their names such dictionaries; collective."""
        totals = [self.at_nodes.totals(part) for part in range(len(self.at_nodes.faces))]
        return totals[0] if len(totals) == 1 else dict(zip(self._sides, totals, strict=True))

    @property
    def heat(self) -> Heat | None:
        """Temperatures and heat flows of a problem with heat; else None."""
        return self.problem.state.heat

    @property
    def force_on_body(self) -> FloatArray:
        """Contact forces on the body at this rank's contact points, space vectors in newtons, shape (m, 3)."""
        return -self.problem.surface.vectors(self.contact_force.reshape(-1, 3))

    @cached_property
    def at_nodes(self) -> NodalAnswer:
        """Fields, totals and counts at this rank's contact nodes."""
        problem, surface = self.problem, self.problem.surface
        return NodalAnswer(
            comm=problem.comm,
            law=problem.law,
            faces=surface.faces,
            part=surface.part,
            x=surface.x,
            frames=surface.frames,
            gap=surface.gap,
            given_gap=problem.body.given_gap(surface, problem.time),
            chord=surface.chord,
            area=surface.area,
            slip_origin=problem.state.slip_origin,
            displacement=surface.rows(self.change),
            force=self.contact_force.reshape(-1, 3),
            slip_bound=self.slip_bound,
            compliance=self.compliances,
            spins=problem.state.spins,
            earlier=problem.state.accumulated,
            force_before=problem.state.force_before,
            against=tuple(contact.against for contact in problem.contacts),
            opposite_x=surface.points.opposite_average(problem.elasticity.x),
            several=len(problem.elasticity.members) > 1,
            copies=problem.elasticity.copies,
        )

    @property
    def forces_at_nodes(self) -> dict[str, FloatArray]:
        """The fields of solution.xdmf of loads and supports, and of bodies of the user's forms their internal forces,
        shapes (k, 3); collective."""
        body, e = self.problem.elasticity, self.evidence
        forces = {"load": e.load, "prescribed": self.problem.prescribed, "spring_force": e.spring + self._linked}
        forces["reaction"] = self._reaction
        if body.forms() is not None or self.problem.body.undeformed:
            forces |= {"internal_force": e.internal, "rounding_force": rounding_forces(body, self.displacement)}
        if self.stability is not None and self.stability.unstable:
            forces["instability_mode"] = self.stability.mode
        return forces | self.tie_fields

    @cached_property
    def _linked(self) -> FloatArray:
        """The forces of springs between nodes, newtons, shape (k, 3); collective."""
        return self.problem.elasticity.constraints.link_force(self.displacement)

    @cached_property
    def _imbalance(self) -> FloatArray:
        """What supports and ties hold, newtons, shape (k, 3); collective."""
        e = self.evidence
        return e.internal - e.spring - self._linked - e.load + self.problem.surface.at_nodes(self.contact_force)

    @cached_property
    def _reaction(self) -> FloatArray:
        """What supports hold, newtons, shape (k, 3); collective."""
        body = self.problem.elasticity
        return body.held.held_part(self._imbalance - body.constraints.forces(self._imbalance, self.problem.time))

    @property
    def tie_fields(self) -> dict[str, FloatArray]:
        """Forces of ties at the nodes, shape (k, 3), and their stresses, shape (k,); collective."""
        body, time = self.problem.elasticity, self.problem.time
        if not body.constraints.ties:
            return {}
        forces = {"tie_force": body.constraints.forces(self._imbalance, time)}
        return forces | body.constraints.stresses(self._imbalance, time)

    @cached_property
    def force_balance(self) -> ForceBalance:
        """Resultants of all loads and supports, and the balance of all forces; collective."""
        on_body = -self.problem.surface.at_nodes(self.contact_force)
        balance = force_balance(self.problem, self.displacement, on_body, self._imbalance, self._reaction)
        return replace(balance, loaded_foundations=motions_of(self.problem.state.loaded, self.at_nodes))

    @property
    def loads(self) -> tuple[Resultant, ...]:
        """Force and moment of every load: in their order, those in the volume first; collective."""
        return self.force_balance.loads

    @property
    def reactions(self) -> tuple[Resultant, ...]:
        """Force and moment of every clamp, prescribed displacement and spring on the body, in their order; collective.

        With the loads and the contact forces on a body (`at_nodes.totals()`) they add up to zero.
        """
        return self.force_balance.reactions

    @property
    def ties(self) -> tuple[Resultant, ...]:
        """Force and moment of every tie on the face whose nodes follow the other, in their order; collective."""
        return self.force_balance.ties

    @property
    def rigid_faces(self) -> tuple[RigidFaceMotion, ...]:
        """Motion of every rigid face, and the force and moment that hold what is prescribed, in their order;
        collective."""
        return self.force_balance.rigid_faces

    @property
    def bolts(self) -> tuple[BoltForce, ...]:
        """Force and shortening of every bolt, in their order; collective."""
        return self.force_balance.bolts

    @property
    def forces_on_foundations(self) -> tuple[Resultant, ...]:
        """Force and moment on the foundation of every contact face, in their order; collective.  Pairs have none."""
        return tuple(on_foundations(self.at_nodes).values())

    @property
    def loaded_foundations(self) -> tuple[RigidFaceMotion, ...]:
        """Motion of every foundation under load, in addition to what is given, and force and moment of contact on it;
        collective."""
        return self.force_balance.loaded_foundations

    @cached_property
    def probes(self) -> tuple[ProbeValue, ...]:
        """Displacement, slip and pressure at the probes of the problem; collective, the same on every rank."""
        return self._at(self._undeformed.probes)

    def probed(self, probes: Sequence[Probe]) -> tuple[ProbeValue, ...]:
        """Displacement, slip and pressure at other points; collective, the same on every rank.

        Raises:
            ValueError: On every rank, if two have the same name, or a point is outside the body.
        """
        return self._at(self._undeformed.located(probes))

    def _at(self, probes: LocatedProbes) -> tuple[ProbeValue, ...]:
        return probes.values(self.displacement, self.at_nodes, self.problem.surface.nodes)

    @property
    def _undeformed(self) -> ContactBody:
        return self.problem.body.undeformed or self.problem.body

    @cached_property
    def small_strain(self) -> SmallStrain:
        """Measures of the small-strain theory; of large motions whether the facets in contact are fine enough, and
        surfaces are outside of each other; collective."""
        problem, body, e = self.problem, self.problem.elasticity, self.evidence
        large = problem.body.undeformed is not None
        members = [body.face(face, "contact") for face in problem.surface.faces]
        faces = [face_samples(one.body, facets, self.change[one.nodes]) for one, facets in members]
        over = Reductions(problem.comm)
        deformation = deformations(e, over)[1][body.component]
        given = np.zeros(len(problem.surface.x)) if large else self.at_nodes.given_gap
        inside = self._undeformed.outside.overlap(
            problem.surface, given, problem.state.foundation_motions, self.displacement, deformation, large
        )
        gradient = 0.0 if large else body.largest_gradient(self.displacement)
        of_pairs = problem.body.off_linear(problem.surface, self.change, self.at_nodes.given_gap)
        foundations = problem.surface.foundations
        at, layer = self.at_nodes, body.slice
        cells = np.sqrt(at.area) if layer is None else layer.cell_sizes(at.x, at.area, members[0][0].body.degree)
        scales = face_scales(e, over)
        measured = small_strain(at, cells, foundations, scales, gradient, faces, inside, large, of_pairs)
        guides = max(member.body.turn_of_guides() for member in body.members)
        measured = replace(measured, turn=max(measured.turn, guides))
        found = self.stability
        return measured if found is None else replace(measured, unstable=found.unstable, by_friction=found.by_friction)

    @cached_property
    def stability(self) -> Stability | None:
        """In how many directions an equilibrium of large motions is unstable; None if it has too many unknowns to look.
        It is stable if the tangent of the last linear problem was positive definite without contact; collective."""
        if self.methods.get("definite"):
            return Stability(0, 0, np.zeros_like(self.displacement))
        return self.problem.stability(self.contact_force)

    @property
    def outside(self) -> tuple[str, ...]:
        """Violations of the small-strain theory as messages; empty if there are none or if they are accepted by
        `ContactProblem(..., small_strain="warn")`; collective."""
        return self.small_strain.violations if self.problem.small_strain == "enforce" else ()

    @property
    def valid(self) -> bool:
        """Whether the certificate passed and the small-strain theory holds, or was not enforced; collective."""
        return self.certificate.passed and not self.outside

    def sensitivities(
        self,
        earlier: Sequence[Sensitivity] = (),
        others: Mapping[str, Posed] | None = None,
        only: Callable[[str], bool] | None = None,
        functionals: Mapping[str, Any] | None = None,
    ) -> list[Sensitivity]:
        """What the answer owes to each input: friction, gaps, loads, prescribed displacements, motions of and loads on
        foundations, Young's moduli; exact derivatives, with how far they hold; collective.  At the sets of the answer
        P x' + Q w' = -(change of the equations), one linear system for each (A. Beremlijski et al., Shape optimization
        in contact problems with Coulomb friction, SIAM J. Optim. 13, 2002).

        Args:
            earlier: In a load step, those of the step before.
            others: More inputs by their names, each a function that poses the problem with the input times a factor, as
                of lengths, radii or directions, in small strains; without totals at probes, whose places stay.
            only: Which of the inputs above are wanted, by their names; all by default.
            functionals: More outputs by their names, as the functional of `gradient`; not along `others`.

        Raises:
            ValueError: With heat in large motions or on foundations under load; in a load step where friction depends
                on the slip rate, or without those of the step before; or if the answer is nearly one of several.
        """
        there = self.problem, self.contact_force, self.displacement, self.at_nodes
        owed = {name: self._functions.owed_by(one, self.at_nodes) for name, one in (functionals or {}).items()}
        return sensitivities(*there, earlier, others, only, owed)

    def gradient(
        self,
        contact_force: FloatArray | None = None,
        displacement: FloatArray | None = None,
        later: Gradient | None = None,
        functional: Any = None,
    ) -> Gradient:
        """What a function J of the answer owes to friction, gaps, loads and Young's modulus of every point, node and
        cell, at the cost of one linear system, the transpose of that of `sensitivities` (the discrete adjoint: M. B.
        Giles, N. A. Pierce, Flow, Turbulence and Combustion 65, 2000); in a load history step by step, the last first;
        collective.

        Args:
            contact_force: dJ/dx, shape (3 m,), as the answer has x; 0 by default.
            displacement: dJ/du, shape (k, 3), as the answer has u; 0 by default.
            later: The gradient of the load step after, through which J owes to this answer as well.
            functional: A form of UFL without arguments that J has besides, of the displacement `function`, and of its
                fields `function("pressure")` and `function("traction")`: the place of the nodes stays.

        Raises:
            ValueError: With foundations under load, with heat, or in a load step where friction depends on the slip
                rate; if the functional is none of this answer, or of contact on faces opposite or in large motions.
        """
        of_x, of_u = contact_force, displacement
        if functional is not None:
            owed = self._functions.owed_by(functional, self.at_nodes)
            of_x, of_u = (of if given is None else of + given for of, given in zip(owed, (of_x, of_u), strict=True))
        return gradient(self.problem, self.contact_force, self.displacement, of_x, of_u, later)

    def write(self, directory: str | Path, fields: Mapping[str, Any] | None = None, *, overwrite: bool = True) -> None:
        """Fields, history, summary and picture into a directory; results that are there are kept as DIRECTORY.previous.

        Args:
            directory: Created if necessary.
            fields: Functions of DOLFINx on the mesh of the body to be written beside, by name: of continuous spaces at
                the nodes, of others in the cells.
            overwrite: Whether results that are there may be replaced.

        Raises:
            OSError: On every rank, if the directory cannot be written to.
            ValueError: On every rank, if a function cannot be written, if a run uses the directory, or if results are
                there that must not be replaced.
        """
        late_bound["write"](self, directory, fields or {}, overwrite)

    def face(self, name: str) -> FaceAnswer:
        """The nodes, facets and fields of a contact face, or of a face opposite in a pair; of a face in several pairs
        with both names, "mid:around against low:top"; collective.

        Raises:
            ValueError: On every rank, if no contact has a face of this name.
        """
        faces: dict[str, FaceAnswer] = late_bound["faces"](self)
        if name not in faces:
            raise ValueError(f"there is no contact face {name!r}; there are {', '.join(map(repr, faces))}")
        return faces[name]

    def error(self, *others: Solution) -> Any:
        """The error bars of all totals, by which they differ from those of the continuum (`io.error_bars.ErrorBars`):
        `solution.error()["totals.normal_force"].bar`; collective, the same on every rank.

        Args:
            others: Answers of the same problem on other meshes, best on two coarser ones.  By default the problem is
                solved again: on two coarser meshes where they can be made (of boxes, and of large first-order meshes),
                else on the same cells with elements of the other order.

        Raises:
            ValueError: On every rank, if the problem cannot be posed or solved on another mesh (a `Body` of the user's
                forms, a load step), or if the others are of another problem or on the same mesh.
        """
        return late_bound["error"](self, *others)

    def table(self) -> dict[str, Any]:
        """This rank's contact points as columns of length m, vectors as three columns: what `pandas.DataFrame` takes;
        collective.

        `contact_face` is the name of the face, with that opposite where it is in several pairs; x, y, z are places
        before deformation in metres; the others are the fields of contact.xdmf.
        """
        answer = self.at_nodes
        columns: dict[str, Any] = {"contact_face": np.array(self._sides)[answer.part]}
        columns |= dict(zip("xyz", answer.x.T, strict=True))
        for name, values in answer.fields().items():
            if values.ndim == 1:
                columns[name] = values
            else:
                columns |= {f"{name}_{axis}": values[:, k] for k, axis in enumerate("xyz")}
        return columns

    @property
    def _sides(self) -> list[str]:
        """The names of the contact faces in files."""
        return [side for side, _ in side_names((contact.face, contact.against) for contact in self.problem.contacts)]

    def plot(self, field: str = "pressure", scale: float | None = None, view: str | None = None) -> Any:
        """A pyvista plotter with the deformed bodies and a field, as of `coulomb plot`; `show()` displays it: in a
        notebook interactively where trame is installed, else as a picture.  Collective; None on ranks other than 0.

        Args:
            field: Of the contact points or of the bodies; vectors also with _x, _y, _z.
            scale: Factor of the displacement; None chooses a visible one.
            view: As of `coulomb plot --view`; None chooses one that shows the field.

        Raises:
            ValueError: If there is no such field or view.
            ModuleNotFoundError: If pyvista is not installed: `pip install "coulomb[pictures]"`.
        """
        return late_bound["plot"](self, field, scale, view)

    def plot_history(self) -> Any:
        """A matplotlib figure of residuals and CG iterations by step of the solver; collective, None on ranks other
        than 0."""
        return late_bound["plot_history"](self)

    def __repr__(self) -> str:
        """Status, verdict, time and sizes on one line, without collective calls."""
        unknowns = ", ".join(f"{count} {what}" for what, count in self.problem.body.unknowns.items())
        verdict = "certificate passed" if self.certificate.passed else "certificate FAILED"
        return f"Solution({self.result.status.value}, {verdict}, time {self.time:g}, {unknowns} unknowns)"

    def __reduce__(self) -> Any:
        raise TypeError(
            "a Solution has meshes and matrices of DOLFINx and PETSc, and cannot be pickled or copied to another "
            "process: pickle solution.certificate, solution.forces, solution.table() and arrays such as "
            "solution.displacement, or solution.write(directory)"
        )

    def _repr_html_(self) -> str:
        """Verdict, totals, certificate and a picture; on several ranks, of which one may ask alone, the certificate."""
        if self.problem.comm.size > 1:
            return self.certificate._repr_html_()
        result, names = self.result, ("normal_force", "contact_area", "greatest_pressure", "greatest_slip")
        units = dict(zip(names, ("N", "m²", "Pa", "m"), strict=True))
        totals = [self.at_nodes.totals(part) for part in range(len(self.at_nodes.faces))]
        rows = [[side, *(one[name] for name in names)] for side, one in zip(self._sides, totals, strict=True)]
        head = ("face", *(f"{name.replace('_', ' ')} ({units[name]})" for name in names))
        words = f"{result.status.value}, residual {result.residual:.1e}: {'valid' if self.valid else 'NOT VALID'}"
        return "".join(
            [
                notebook.verdict(self.valid, words),
                *(f"<p>{text}</p>" for text in self.outside),
                notebook.table(head, rows),
                self.certificate._repr_html_(),
                self._picture,
            ]
        )

    @cached_property
    def _picture(self) -> str:
        return str(late_bound["picture"](self))


def warn(answer: Solution) -> None:
    """Log violations and warnings of the small-strain theory on one rank; collective."""
    strain = answer.small_strain
    if answer.problem.comm.rank == 0:
        for text in strain.violations:
            _log.warning("outside the theory: %s", text)
        for text in strain.mere_warnings:
            _log.warning("%s", text)
