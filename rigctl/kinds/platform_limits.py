"""Which runs of the rotating platform a rig can carry out: its limits, and what a pattern has to reject."""

from __future__ import annotations

from procedures.rotating_platform.bias_rejection import Plan
from procedures.rotating_platform.tables import ListedRun, Procedure
from rigctl.core.errors import ConfigError, LimitError
from rigctl.files import config
from rigctl.kinds.rotating_platform import bench_of
from rigctl.rig import Rig
from rigctl.workbench.next.recommend import Allowed
from rigctl.workbench.study import Proposal


def within(rig_file: config.RigFile, procedure: Procedure) -> Allowed:
    """Whether a rig can carry out a proposal; what that does not say is as in `procedure`."""
    bench = bench_of(Rig.for_its_limits(rig_file), procedure)

    def allowed(proposal: Proposal) -> bool:
        run = ListedRun.model_validate(dict(proposal.settings))
        try:
            Plan(procedure.model_copy(update={"runs": (run,)})).check(bench)
        except (LimitError, ConfigError):
            return False
        return True

    return allowed
