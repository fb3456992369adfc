"""Results of the check of a run, of a load step and of a load history, in lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from ..io.field_files import data_of
from ..io.run_directory import CASE, FIELDS, HISTORY, SUMMARY, RunDirectory
from ..model.certificate import Certificate

_MOST: Final = 12
"""Maximum number of faults listed; one wrong number causes many."""


@dataclass(frozen=True)
class Findings:
    """Result of the check of a run, a load step or a load history.

    Attributes:
        certificate: Certificate of displacement and contact forces; None of a history, or if the files alone were
            judged.
        outside: Violations of the theory of small strains, unless they were accepted.
        faults: Data that do not follow from displacement and contact forces, from the problem or from the steps, a line
            each.
        taken: Data that could not be compared or are missing, a line each.
        unjudged: Names of the data in the files for which there is nothing to compare with.
        steps: Of a history.
    """

    contents: Mapping[str, Any]
    certificate: Certificate | None
    outside: Sequence[str]
    faults: Sequence[str]
    taken: Sequence[str]
    unjudged: Sequence[str]
    steps: Sequence[Findings] = ()

    @property
    def number(self) -> int:
        """That of a load step."""
        return int(self.contents["step"]["number"])

    @property
    def recorded(self) -> bool:
        """Whether the run itself recorded that its certificate, or those of all steps, had passed."""
        if self.steps:
            return all(step.recorded for step in self.steps)
        return bool(self.contents["certificate"]["passed"])

    @property
    def certified(self) -> bool:
        """Whether the certificate passes; without a problem, whether it is recorded to have passed."""
        return self.recorded if self.certificate is None else self.certificate.passed

    @property
    def passed(self) -> bool:
        """Whether all certificates pass, the answers are inside the theory, and all data agree."""
        certified = all(step.passed for step in self.steps) if self.steps else self.certified
        return certified and not self.outside and not self.faults

    @property
    def trusted(self) -> tuple[str, ...]:
        """Data that could not be compared, a line each."""
        return *self.taken, f"as recorded by the run, nothing to compare with: {', '.join(self.unjudged)}"

    @property
    def details(self) -> str:
        """Lines about what has failed."""
        failed = "certificate FAILED, as recorded by the run" if self.certificate is None else str(self.certificate)
        lines = [] if self.certified else failed.splitlines()
        return "\n".join(f"  {line}" for line in [*lines, *self._beyond, *_verdict(self.faults)])

    @property
    def of_step(self) -> str:
        """A line about a load step, and lines about what has failed."""
        line = f"step {self.number:3d}  time {self.contents['step']['time']:<8.4g}"
        verdict = "certificate passed" if self.certificate is None else self.certificate.verdict
        return f"{line} {verdict}, files agree" if self.passed else f"{line} FAILED\n{self.details}"

    @property
    def ending(self) -> str:
        """All lines but those of steps."""
        which = "certificates" if self.steps else "certificate"
        before = f"recorded by the run: {which} {'had passed' if self.recorded else 'had FAILED'}"
        certificate = [] if self.certificate is None else [str(self.certificate)]
        lines = [*certificate, *self._beyond, before, *_verdict(self.faults), *self.trusted]
        if self.steps:
            besides = ", but the files of the whole FAILED" if self.faults else ""
            good = sum(step.passed for step in self.steps)
            lines.append(f"{good} of {len(self.steps)} load steps passed{besides}")
        return "\n".join(lines)

    @property
    def _beyond(self) -> list[str]:
        return [f"outside the theory: {text}" for text in self.outside]

    def __str__(self) -> str:
        return "\n".join([*(step.of_step for step in self.steps), self.ending])


def _verdict(faults: Sequence[str]) -> list[str]:
    """Lines about the comparison of fields and numbers."""
    if not faults:
        return ["files agree: every field and number that can be computed again"]
    more = [f"  and {len(faults) - _MOST} more"] if len(faults) > _MOST else []
    return ["files FAILED:", *(f"  {fault}" for fault in faults[:_MOST]), *more]


def unread(files: RunDirectory) -> list[str]:
    """Names of the files of a run, or of a load history, that are not compared, and of what a case has that does not
    change the answer."""
    read = (SUMMARY, *FIELDS, *((HISTORY,) if files.is_history else [data_of(name).name for name in FIELDS]))
    found = sorted(path.name for path in files.path.iterdir() if path.is_file() and path.name not in (*read, CASE))
    method = ("output", "solver", "halvings") if files.case.exists() else ()
    step = " of the step" if files.step_number is not None else ""
    return [f"{name}{step}" for name in [*found, *(f"{name} of {CASE}" for name in method)]]
