"""What is told of a drive: a table of laps, the course cycle by cycle, and a summary."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from drive import Drive


def lap_table(drive: Drive) -> str:
    """laps.csv: one row for each lap, times in seconds."""
    rows = ["lap,mode,begin,time,top_speed,overtakes"]
    for number, lap in enumerate(drive.world.laps, 1):
        inside = [i for i, m in enumerate(drive.world.moments) if lap.begin <= m.time < lap.end]
        top = max(drive.world.moments[i].speed for i in inside)
        overtakes = sum(i in inside for i in drive.world.overtakes)
        rows.append(f"{number},{drive.mode_of(lap)},{lap.begin:.3f},{lap.time:.3f},{top:.2f},{overtakes}")
    return "\n".join(rows) + "\n"


def course(drive: Drive) -> str:
    """drive.csv: where the car was at the beginning of every cycle, and how well it knew."""
    rows = ["time,mode,x,y,heading,speed,wall,opponent,pose_error"]
    for mode, m in zip(drive.modes, drive.world.moments, strict=True):
        gap = "" if m.gap is None else f"{m.gap:.3f}"
        error = "" if m.error is None else f"{m.error[0]:.4f}"
        place = f"{m.x:.4f},{m.y:.4f},{m.heading:.4f},{m.speed:.3f},{m.clearance:.3f}"
        rows.append(f"{m.time:.3f},{mode},{place},{gap},{error}")
    return "\n".join(rows) + "\n"


def summary(drive: Drive) -> str:
    """What happened, in a few lines."""
    moments = drive.world.moments
    errors = [m.error for m in moments if m.error is not None]
    metres, turns = np.array([e for e, _ in errors]), np.array([abs(t) for _, t in errors])
    gaps = [m.gap for m in moments if m.gap is not None]
    lines = ["lap  mode        time      top speed"]
    for row in lap_table(drive).splitlines()[1:]:
        number, mode, _, time, top, overtakes = row.split(",")
        note = f"   overtakes {overtakes}" if overtakes != "0" else ""
        lines.append(f"{number:<4} {mode:<11} {time:>6} s  {top} m/s{note}")
    for i in range(1, len(moments)):
        if drive.modes[i] != drive.modes[i - 1]:
            lines.append(
                f"{drive.modes[i - 1]} to {drive.modes[i]} at {moments[i].time:.3f} s, {moments[i].speed:.2f} m/s"
            )
    end = "stands" if drive.finished else "still drives"
    lines.append(f"{len(moments)} cycles, {moments[-1].time:.3f} s; the car {end} at the end")
    near = f", to the opponent {100 * min(gaps):.0f} cm" if gaps else ""
    nearest = min(m.clearance for m in moments)
    lines.append(f"{drive.collisions} collisions; least distance to a wall {100 * nearest:.0f} cm{near}")
    if errors:
        lines.append(
            f"pose: mean error {100 * metres.mean():.1f} cm, 95 % below {100 * np.quantile(metres, 0.95):.1f} cm, "
            f"largest {100 * metres.max():.1f} cm and {math.degrees(turns.max()):.1f} degrees"
        )
    return "\n".join(lines) + "\n"
