"""Linux bundles on the machine at hand: built, run for a while, and their recordings compared with the schedule."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from halpipe.deploy.base import Checked, CheckOptions, Target


class LinuxDeployment:
    """Builds a bundle, plays every mode and every switch, and judges the recording."""

    name = "linux"
    summary = "run of a Linux bundle on this machine: order, exclusion, missing and late jobs, start errors"
    engines = ("native",)
    takes = ("engine", "cycles", "seconds")
    facts = ("model", "cpus", "priority", "generator")

    def check(self, target: Target, options: CheckOptions) -> Checked:
        """Build, run and judge; see `halpipe.deploy.base.Deployment`."""
        from halpipe.deploy.linux.judging import check

        return check(target, options)


DEPLOYMENT = LinuxDeployment()
