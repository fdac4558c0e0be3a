"""The diagnostics of choosing one ECU, or one variant, of what is read: HAL0575 to HAL0579, HAL0585 to HAL0589."""

from halpipe.diagnostics import error, note, warning

SEVERAL_ECUS = error(
    "HAL0575",
    "System has several ECUs",
    "Components are mapped to more than one ECU. A schedule is made for one: name it with --ecu.",
)
UNKNOWN_ECU = error(
    "HAL0576",
    "ECU is not in the system",
    "The name after --ecu is the short name, or the path, of an ECU-INSTANCE that components are mapped to.",
)
BOUNDARY = note(
    "HAL0577",
    "Data shared with another ECU",
    "It comes from, or goes to, a component on another ECU, and is external input or output of this one. It "
    "arrives when the other ECU and the network have sent it.",
)
UNMAPPED_COMPONENT = error(
    "HAL0578",
    "Component is mapped to no ECU",
    "In a system of several ECUs, each component instance, or a composition that holds it, is mapped to one of them "
    "(SWC-TO-ECU-MAPPING). It is not known whether this one belongs to the ECU that was chosen.",
)
UNLINKED = warning(
    "HAL0579",
    "ECU configuration belongs to no ECU",
    "The ECU of an ECU configuration is that of the SYSTEM which its ECUC-VALUE-COLLECTION names, of the instances "
    "that its Rte names, or the one it is called after. It is left out, or taken for the only ECU without one.",
)
