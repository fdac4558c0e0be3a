"""Check of an AUTOSAR project with a schedule on top: its OS is played, and compared with the schedule."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from halpipe.deploy.base import Checked, CheckOptions, Target


class OntoDeployment:
    """Plays alarms and schedule tables of the project as it will be: its files, those changed, and the delta."""

    name = "arxml-onto"
    summary = "play of the OS of a merged AUTOSAR project: activations and events of each OsTask over a hyperperiod"
    engines = ("player",)
    takes = ()
    facts = ("project", "code", "tables", "tasks")

    def check(self, target: Target, options: CheckOptions) -> Checked:
        """Play and compare; see `halpipe.deploy.base.Deployment`."""
        from halpipe.deploy.arxml.check import check

        return check(target)


DEPLOYMENT = OntoDeployment()
