"""RISC-V bundles on simulated boards: co-simulation, QEMU and Spike, and the comparison with the schedule."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.suggest import did_you_mean
from halpipe.deploy.riscv.codes import BAD_REQUEST
from halpipe.deploy.riscv.run.cosimulation import CoSimulation, Run
from halpipe.deploy.riscv.run.drivers import Board, Plant

if TYPE_CHECKING:
    from halpipe.deploy.base import Checked, CheckOptions, Target


class RiscvDeployment:
    """Check of a bundle: play it on emulated cores, and compare what is seen with its schedule."""

    name = "riscv"
    summary = "co-simulation of a RISC-V bundle: every start, end, transfer and fault against the schedule"
    engines = ("cosim", "qemu", "spike")
    takes = ("engine", "cycles", "seconds", "modelled", "inject", "margin")
    facts = ("model", "profile", "toolchain", "generator", "regulator")

    def check(self, target: Target, options: CheckOptions) -> Checked:
        """Play every mode and every transition; see `halpipe.deploy.base.Deployment`."""
        from halpipe.core.options import refuse_unused
        from halpipe.deploy.regulator import with_tables
        from halpipe.deploy.riscv.judge.check import check_by_simulation
        from halpipe.deploy.riscv.judge.qemu import check_by_qemu
        from halpipe.deploy.riscv.judge.spike import check_by_spike

        engine = "cosim" if options.engine == "auto" else options.engine
        unused = {"cosim": (), "qemu": ("modelled", "margin", "inject"), "spike": ("modelled", "margin")}
        if engine not in unused:
            known = ("auto", *self.engines)
            help = did_you_mean(options.engine, known, "choose one of " + ", ".join(known))
            raise HalpipeError(BAD_REQUEST(f'there is no engine "{options.engine}"', help=help))
        refuse_unused(options, f"deploy check --engine {engine}", unused[engine])
        play = {"cosim": check_by_simulation, "qemu": check_by_qemu, "spike": check_by_spike}[engine]
        return with_tables(target, play(target, options))


DEPLOYMENT = RiscvDeployment()

__all__ = ["DEPLOYMENT", "Board", "CoSimulation", "Plant", "Run"]
