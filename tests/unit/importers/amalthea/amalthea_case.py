"""Shorthands for tests of the AMALTHEA importer: small models, written element by element."""

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.importers.amalthea import FORMAT, AmaltheaImportOptions

NAMESPACES = (
    'xmlns:am="http://app4mc.eclipse.org/amalthea/{}" xmlns:xmi="http://www.omg.org/XMI" '
    'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmi:version="2.0"'
)

# Two cores of type A at 100 MHz (a tick is 10 ns), one of type B at 200 MHz.
HARDWARE = """
<definitions xsi:type="am:ProcessingUnitDefinition" name="A"/>
<definitions xsi:type="am:ProcessingUnitDefinition" name="B"/>
<structures name="S">
 <modules xsi:type="am:ProcessingUnit" name="a0" frequencyDomain="slow?type=FrequencyDomain" definition="A?type=ProcessingUnitDefinition"/>
 <modules xsi:type="am:ProcessingUnit" name="a1" frequencyDomain="slow?type=FrequencyDomain" definition="A?type=ProcessingUnitDefinition"/>
 <modules xsi:type="am:ProcessingUnit" name="b0" frequencyDomain="fast?type=FrequencyDomain" definition="B?type=ProcessingUnitDefinition"/>
</structures>
<domains xsi:type="am:FrequencyDomain" name="slow"><defaultValue value="100.0" unit="MHz"/></domains>
<domains xsi:type="am:FrequencyDomain" name="fast"><defaultValue value="0.2" unit="GHz"/></domains>
"""  # noqa: E501

PLAIN_STIMULI = '<stimuli xsi:type="am:PeriodicStimulus" name="p10"><recurrence value="10" unit="ms"/></stimuli>'


class Overlay:
    """Stands in for an overlay in use."""

    names_units = False

    def __init__(self, sources=None, drop=(), periods=None):
        self.sources, self.drop, self.periods = sources or {}, drop, periods or {}

    def drops(self, name):
        return name in self.drop

    def source_period(self, name):
        return Duration.parse(self.sources[name]) if name in self.sources else None

    def task_wcet(self, name, *, is_known):
        return None

    def work_wcet(self, name):
        return None

    def states_interrupt(self, name):
        return False

    def task_period(self, name):
        return Duration.parse(self.periods[name]) if name in self.periods else None


def document(version="1.0.0", **models):
    """A model of its parts: ``sw``, ``hw``, ``stimuli``, ``events``, ``constraints``, ``mapping``, ``os``."""
    names = {"sw": "swModel", "hw": "hwModel", "os": "osModel", "events": "eventModel", "mapping": "mappingModel"}
    names |= {"stimuli": "stimuliModel", "constraints": "constraintsModel"}
    body = "\n".join(f"<{names[part]}>\n{text}\n</{names[part]}>" for part, text in models.items())
    return f"<am:Amalthea {NAMESPACES.format(version)}>\n{body}\n</am:Amalthea>\n"


def ticks(value):
    """Ticks for every kind of unit."""
    return f'<items xsi:type="am:Ticks"><default xsi:type="am:DiscreteValueConstant" value="{value}"/></items>'


def runnable(name, *steps):
    return f'<runnables name="{name}"><activityGraph>{"".join(steps)}</activityGraph></runnables>'


def call(name):
    return f'<items xsi:type="am:RunnableCall" runnable="{name}?type=Runnable"/>'


def task(name, *steps, stimuli="p10?type=PeriodicStimulus"):
    stated = f' stimuli="{stimuli}"' if stimuli else ""
    return f'<tasks name="{name}"{stated}><activityGraph>{"".join(steps)}</activityGraph></tasks>'


def stimulus(name, kind, *parts, **attributes):
    stated = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return f'<stimuli xsi:type="am:{kind}" name="{name}"{stated}>{"".join(parts)}</stimuli>'


def write(folder, text, name="model.amxmi"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return str(path)


def read(folder, *, overlay=None, strict=False, memory="within", bind="stated", **models):
    """Import a model of the given parts, with hardware and one stimulus of 10 ms unless stated."""
    version = models.pop("version", "1.0.0")
    models = {"hw": HARDWARE, "stimuli": PLAIN_STIMULI} | models
    options = AmaltheaImportOptions(overlay=overlay, strict=strict, memory=memory, mapping=bind)
    return FORMAT.read([write(folder, document(version, **models))], options).completed()


def refusal(function, *arguments, **options):
    """Return the exception of an import that fails."""
    try:
        function(*arguments, **options)
    except HalpipeError as failure:
        return failure
    raise AssertionError("the import succeeded")


def files(*paths, **options):
    return FORMAT.read([str(path) for path in paths], AmaltheaImportOptions(**options))


def found(diagnostics, code):
    return [d for d in diagnostics if d.code == code.id]


def wcets(imported):
    """The WCET of every version of every task."""
    return {t.name: {v.name: str(v.wcet) for v in t.versions} for t in imported.model.tasks}


def windows(imported, name, version=0):
    return [
        (p.task, str(p.anchor), str(p.min), str(p.max)) for p in imported.model.task(name).versions[version].precedences
    ]


def reasons(imported, kind):
    return {e.name: e.reason for e in imported.coverage.ignored_elements if e.kind == kind}
