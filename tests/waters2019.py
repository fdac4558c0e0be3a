"""The autonomous driving system of the WATERS 2019 industrial challenge, as far as its published parameters say.

Source: A. Hamann, D. Dasari, F. Wurst (Bosch), I. Sanudo, N. Capodieci, P. Burgio, M. Bertogna (UNIMORE), "WATERS
Industrial Challenge 2019": NVIDIA Jetson TX2 with four A57 cores, two Denver cores and one GPU; periods and worst-case
execution times (ticks over the frequency of the core type: A57 and Denver 2 GHz, GPU 1.5 GHz) of ten periodic tasks.
Four of them prepare data, offload to the GPU (or run the function on a core), wait, and post-process. Each such task is
three here, with precedence: pre -> function -> post. WCETs are rounded up to 0.01 ms; the copies to and from the GPU
cost 0.0025 ms, in pre. What is ours: the windows (a stage starts within a period of the end of the one before).
"""

from dataclasses import replace

from halpipe.models import Unit
from support import after, model, task, version

A57 = "core2 core3 core4 core5"
DENVER = "core0 core1"
GPU = "gpu"

PLAIN = {  # period, A57, Denver
    "os_overhead": ("100ms", "50ms", "50ms"),
    "lidar_grabber": ("33ms", "13.66ms", "10.87ms"),
    "dasm": ("5ms", "1.86ms", "1.3ms"),
    "can_polling": ("10ms", "0.6ms", "0.6ms"),
    "ekf": ("15ms", "4.76ms", "4.43ms"),
    "planner": ("15ms", "13.25ms", "12.44ms"),
}
OFFLOADING = {  # period, (pre: A57, Denver), (function: A57, Denver, GPU), (post: A57, Denver)
    "sfm": ("33ms", ("3.74ms", "3.19ms"), ("29.51ms", "27.82ms", "7.9ms"), ("4.18ms", "3.54ms")),
    "localization": ("400ms", ("8.95ms", "8.22ms"), ("387.42ms", "294.81ms", "124ms"), ("8.7ms", "6.3ms")),
    "lane_detection": ("66ms", ("3.98ms", "3.53ms"), ("51.05ms", "42.24ms", "27.34ms"), ("4.26ms", "4.1ms")),
    "detection": ("200ms", ("3.7ms", "3.18ms"), (None, None, "116ms"), ("1.02ms", "0.91ms")),
}


ON_GPU = {"sfm", "detection"}
"""The functions that the solution of Krawczyk, Bazzal, Govindarajan and Wolff (WATERS 2019) leaves on the GPU."""


def waters2019(*, mapped=False, slack=0, cores="", gpus="", slacks=None):
    """Build the model: functions run on any unit that has a WCET for them, or, `mapped`, where that solution put them.

    `cores` and `gpus` name A57 cores and GPUs beyond those of the TX2; `slacks` gives single tasks another slack.
    """
    homes = {"a57": f"{A57} {cores}".strip(), "denver": DENVER, "gpu": f"{GPU} {gpus}".strip()}

    def one(name, period, wcets, *parts):
        versions = [version(t, c, homes[t], *parts) for t, c in zip(homes, wcets, strict=False) if c]
        return task(name, period, *versions, slack=(slacks or {}).get(name, slack))

    tasks = [one(name, period, wcets) for name, (period, *wcets) in PLAIN.items()]
    for name, (period, pre, function, post) in OFFLOADING.items():
        if mapped:
            function = (None, None, function[2]) if name in ON_GPU else function[:2]
        tasks.append(one(f"{name}_pre", period, pre))
        tasks.append(one(name, period, function, after(f"{name}_pre", "0ms", period, "end")))
        tasks.append(one(f"{name}_post", period, post, after(name, "0ms", period, "end")))
    plain = model(*tasks, name="waters2019")
    units = tuple(Unit(name=unit, type=type) for type, names in homes.items() for unit in names.split())
    return replace(plain, units=units)
