"""Bandwidth regulators: one statement of each device, read by its exporter and by its check.

A statement has the settings of platform files and how the device takes budgets. Its writer and templates are in
``exporters/regulator``, its model in ``deploy/regulator``, both named after the device.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Mapping

MOST = 10**9 - 1


@record
class Setting:
    """A key of a platform file: its default, as text, and the `kind` of its values: a number in a range, or a word."""

    default: str
    kind: str = "number"
    least: int = 0
    most: int = MOST
    words: tuple[str, ...] = ()


@record(kw_only=True)
class Device:
    """A kind of regulator.

    `least` is the smallest budget that a row can be given, in bursts: what an idle row may use all the same. `reserves`
    names the rows for which that and the overshoot are kept: those that are ``used``, both directions of units that
    are (``units``), or ``all``. Of a device with `rates`, a unit has one rate for a whole table and no windows. With
    `carries`, a burst that was shown in a window may pass in the next one, whatever the budget there.
    """

    name: str
    settings: Mapping[str, Setting]
    least: int = 0
    reserves: str = "used"
    rates: bool = False
    carries: bool = False

    @property
    def folder(self) -> str:
        """The name of the folder of the writer, and of the module of the model."""
        return self.name.replace("-", "_")

    @property
    def defaults(self) -> dict[str, str]:
        """Every setting with its default."""
        return {name: setting.default for name, setting in self.settings.items()}


GRANULARITY = Setting("mode", "word", words=("mode", "phase"))

DEVICES: Mapping[str, Device] = {
    device.name: device
    for device in (
        # As many entries as its registers have addresses for.
        Device(
            name="table",
            carries=True,
            settings={
                "depth": Setting("1024", least=2, most=65280),
                "switches": Setting("needed", "word", words=("needed", "all")),
                "base": Setting("", "address"),
                "timebase": Setting("", "frequency"),
                "drift": Setting("100", most=1000),
            },
        ),
        Device(
            name="axi-realm",
            least=1,
            reserves="units",
            settings={
                "managers": Setting("8", least=1, most=32),
                "regions": Setting("2", least=1, most=16),
                "pending": Setting("8"),
                "writes-per-window": Setting("64"),
                "base": Setting("0x0", "address"),
                "bursts": Setting("any", "word", words=("any", "modifiable")),
            },
        ),
        Device(
            name="qos400",
            reserves="all",
            rates=True,
            settings={
                "clock": Setting("533333333Hz", "frequency"),
                "granularity": GRANULARITY,
                "burstiness": Setting("1", least=1, most=2**16 - 1),
            },
        ),
        Device(
            name="memguard",
            rates=True,
            settings={
                "line": Setting("64B", "size"),
                "period": Setting("", "period"),
                "cores": Setting("0", least=1, most=256),
                "write-backs": Setting("1", "ratio"),
                "write-refills": Setting("1", "ratio"),
                "granularity": GRANULARITY,
            },
        ),
        Device(
            name="resctrl",
            rates=True,
            settings={
                "kind": Setting("intel", "word", words=("intel", "amd", "mpam")),
                "domain": Setting("0"),
                "others": Setting("", "numbers"),
                "min": Setting("", most=100),
                "step": Setting("", least=1, most=100),
                "max": Setting("", least=1, most=2**20),
                "width": Setting("8", least=1, most=16),
                "levels": Setting("", "levels"),
            },
        ),
    )
}
