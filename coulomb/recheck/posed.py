"""The problem of a run posed anew, and displacement and contact forces of the files put into it: judged, and made into
fields and numbers by the rooms that wrote the run, but without its solver."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from mpi4py import MPI

from ..case.case import Case
from ..case.files import named_files
from ..case.record import written_case
from ..contact_fields import COMPLIANCES
from ..fem.bodies import TEMPERATURE
from ..io.field_files import WHOLE
from ..io.history_files import at_points, points_in_files
from ..io.output import finite
from ..io.run_directory import RunDirectory
from ..io.summary import summary
from ..model.certificate import judge, settled_to
from ..model.heated import at_contact
from ..model.large_motions import LoadStepLoop
from ..model.load_step import LoadStep
from ..model.problem import ContactProblem
from ..model.problem_evidence import gather_evidence
from ..model.solution import Solution
from ..model.state import State
from ..solvers.results import SolverResult, Status
from .comparison import perturbed
from .fields import whole

OF_SOLVER: Final = (
    *("status", "method", "iterations", "residual", "unsettled", "contraction", "mean_compliance"),
    *("seconds", "peak_memory_bytes", "versions", "coulomb"),
)
"""Entries of a summary that do not follow from the answer."""

SEEDS: Final = (0, 1, 2)
"""Seeds of the answers that are judged: 0 as written, the others with its numbers perturbed."""


@dataclass(frozen=True)
class Posed:
    """A problem posed anew; its case, None if it was given in Python."""

    problem: ContactProblem
    settings: Case | None

    @staticmethod
    def of(folder: Path, problem: ContactProblem | None) -> Posed | str:
        """That of the results in a directory, or in words why there is none; collective.

        Raises:
            ValueError: On every rank, if case.json is no case, or its problem cannot be posed.
        """
        if problem is not None:
            return Posed(problem, None)
        if not RunDirectory(folder).case.exists():
            return "there is no case.json"
        settings = written_case(folder)
        files = named_files(settings.model_dump(mode="json", exclude_unset=True, exclude={"output"}))
        if lost := sorted({name for name in files.values() if not Path(name).exists()}):
            return f"{', '.join(lost)} is not there"
        try:
            return Posed(settings.problem(MPI.COMM_SELF), settings)
        except ValueError as error:
            raise ValueError(f"{RunDirectory(folder).case}: its problem cannot be posed: {error}") from None

    def accepts(self, record: Mapping[str, Any]) -> bool:
        """Whether answers outside the theory of small strains are accepted; of a load step also by the case that it was
        computed from, if that is recorded: the setting may change between steps."""
        before: Any = record.get("case", {}).get("tables", {"small_strain": "warn"})
        given = self.settings.small_strain if self.settings is not None else self.problem.small_strain
        return bool(given == "warn" == (before.get("small_strain") if self.settings is not None else "warn"))


class WrittenAnswer:
    """Displacement and contact forces in the files of a run or a load step, and what else is taken from these.

    Args:
        problem: The problem posed anew, at any time.

    Attributes:
        numbers: On rank 0 the numbers there of the nodes of all ranks, by the names of bodies in files.
    """

    def __init__(self, files: RunDirectory, problem: ContactProblem):
        self.contents, comm = files.read_summary(), problem.comm
        bodies, faces = points_in_files(files, problem)
        self.numbers = {name or WHOLE: whole(comm, number) for name, number, _ in bodies}
        self.displacement = at_points(files.solution, "displacement", bodies, comm)
        self.force_on_body = at_points(files.contact, "contact_force", faces, comm)
        compliances = [at_points(files.contact, name, faces, comm)[:, 0] for name in COMPLIANCES]
        self._compliances = np.column_stack(compliances)
        self._temperature = None
        if problem.body.heat is not None:
            self._temperature = at_points(files.solution, TEMPERATURE, bodies, comm)[:, 0]

    def judged(self, problem: ContactProblem, seed: int) -> Solution:
        """Judged in a problem posed at their time, as written or with rounding errors; collective."""
        u, f, change, said = self.displacement, self.force_on_body, self._temperature, self.contents
        if seed:
            random = np.random.default_rng((seed, problem.comm.rank))
            u, f = perturbed(u, random), perturbed(f, random)
            change = None if change is None else perturbed(change, random)
        poses, unsettled = problem.body.recorded_poses(said), said.get("unsettled")
        if problem.large is not None:
            return LoadStepLoop(problem, problem.large).recomputed(u, f, self._compliances, unsettled, poses)
        if change is not None:
            loading = problem.elasticity.heated(problem.loading, change)
            problem = problem.in_state(replace(problem.state, loading=loading), problem.seconds, problem.before)
        if poses is not None:
            state = problem.body.posed(problem.state, poses, problem.before)
            problem = problem.in_state(state, problem.seconds, problem.before)
        places = problem.body.places(problem.surface)
        x, compliances = -problem.surface.force_components(f[places]).ravel(), self._compliances[places]
        bound = problem.slip_bound(x)
        evidence = gather_evidence(problem.body, problem.state, x, u, compliances, problem.before)
        evidence, certificate = settled_to(evidence, judge(evidence), unsettled)
        result = SolverResult(x, x, bound, np.zeros((len(bound), 2)), Status.STAGNATED, float("nan"))
        recorded = compliances, float(said["mean_compliance"]), dict(said["method"])
        answer = Solution(problem, x, u, bound, result, certificate, evidence, *recorded)
        if change is None or problem.body.heat is None:
            return answer
        flows, of_heat = problem.body.heat.flows(*at_contact(answer), change), said.get("heat", {})
        heat = replace(flows, rounds=of_heat.get("rounds", 0), agreement=of_heat.get("agreement", 0.0))
        return replace(answer, problem=problem.in_state(replace(problem.state, heat=heat), None, problem.before))


def numbers_of(answer: Solution, contents: Mapping[str, Any], state: State | None) -> dict[str, Any]:
    """The summary of an answer, of a load step with the state after it; collective.

    The numbers of the run in it are those of `contents`, the summary of the files.
    """
    numbers = {name: value for name, value in summary(answer).items() if name not in OF_SOLVER}
    if state is not None:
        row = LoadStep(answer, state, 0).row
        row |= {"path_following": contents["iterations"]["path_following"], "residual": contents["residual"]}
        of_run = {name: value for name, value in contents["step"].items() if name == "friction_error"}
        row |= of_run
        record = {"number": state.number, "time": state.time, "energy": asdict(state.energy), "row": row}
        numbers["step"] = record | of_run
    return dict(json.loads(json.dumps(finite(numbers))))
