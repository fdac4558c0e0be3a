"""The diagnostics of choosing one ECU, or one variant, of what is read: HAL0575 to HAL0579, HAL0585 to HAL0589."""

from halpipe.core.diagnostics import error, note, warning

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

UNKNOWN_VARIANT = error(
    "HAL0585",
    "Variant is not in the input",
    "The name after --variant is the short name, or the path, of a PREDEFINED-VARIANT, or of an EVALUATED-VARIANT-SET "
    "that names one of them. The name in a --condition is that of a system constant or variant criterion.",
)
BAD_FORMULA = error(
    "HAL0586",
    "Formula of a variation point cannot be evaluated",
    "Formulas have references to system constants, numbers, the operators of C and `defined(...)`.",
)
UNSET_CONSTANT = error(
    "HAL0587",
    "Variant does not set what a condition needs",
    "Whether the element exists depends on a system constant, or a variant criterion, that the variant gives no value. "
    "It is not taken to be 0.",
)
TWO_VALUES = error(
    "HAL0588",
    "Variant sets a constant twice",
    "Two value sets of one variant, or a value set and a --condition, give a system constant or variant criterion "
    "different values.",
)
