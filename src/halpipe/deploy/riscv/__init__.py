"""RISC-V bundles on a simulated board: co-simulation, and the check against the schedule."""

from __future__ import annotations

from importlib.util import find_spec
from shutil import which
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.suggest import did_you_mean
from halpipe.deploy.riscv.codes import BAD_REQUEST
from halpipe.deploy.riscv.run.cosimulation import CoSimulation, Run
from halpipe.deploy.riscv.run.drivers import Board, Plant

if TYPE_CHECKING:
    from halpipe.deploy.base import Checked, CheckOptions, Target


class RiscvDeployment:
    """Plays a bundle on emulated cores and holds what is seen against its schedule."""

    name = "riscv"
    summary = "co-simulation of a RISC-V bundle: every start, end, transfer and fault against the schedule"
    engines = ("cosim", "qemu")
    takes = ("engine", "cycles", "seconds", "modelled", "inject", "margin")
    facts = ("model", "profile", "toolchain", "generator", "regulator")

    def check(self, target: Target, options: CheckOptions) -> Checked:
        """Play every mode and every transition; see `halpipe.deploy.base.Deployment`."""
        from halpipe.deploy.regulator import with_tables
        from halpipe.deploy.riscv.judge import check

        engine = self._best(target) if options.engine == "auto" else options.engine
        if engine == "cosim":
            return with_tables(target, check.check_by_simulation(target, options))
        if engine == "qemu":
            from halpipe.core.options import refuse_unused
            from halpipe.deploy.riscv.judge.qemu import check_by_qemu

            refuse_unused(options, "deploy check with QEMU", ("modelled", "margin"))
            return with_tables(target, check_by_qemu(target, options))
        known = ("auto", *self.engines)
        help = did_you_mean(options.engine, known, "choose one of " + ", ".join(known))
        raise HalpipeError(BAD_REQUEST(f'there is no engine "{options.engine}"', help=help))

    def _best(self, target: Target) -> str:
        """Return the co-simulation, and QEMU only where it alone is installed and can play the bundle."""
        from halpipe.deploy.riscv.judge.qemu import EMULATOR
        from halpipe.deploy.riscv.target import read_site

        if find_spec("unicorn") is None and read_site(target.bundle).qemu and which(EMULATOR):
            return "qemu"
        return "cosim"


DEPLOYMENT = RiscvDeployment()

__all__ = ["DEPLOYMENT", "Board", "CoSimulation", "Plant", "Run"]
