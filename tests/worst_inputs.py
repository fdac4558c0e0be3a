"""The worst inputs of each reader, at any size: (command, file, content)."""

from __future__ import annotations

MODEL = "urn:halpipe:task-model:1"
SCHEDULE = "urn:halpipe:schedule:1"
ARXML = "http://autosar.org/schema/r4.0"


def times(size, piece, before="", after=""):
    """Repeat a piece, with {i} as its number, until the whole has about `size` bytes."""
    count = max(1, (size - len(before) - len(after)) // max(1, len(piece)))
    return before + "".join(piece.replace("{i}", str(i)) for i in range(count)) + after


def model(size, tasks="", units="<unit name='u'/>", modes=None, rest=""):
    begin = f"<task-model xmlns='{MODEL}' name='m'>\n<platform>{units}</platform>\n<tasks>\n"
    end = f"</tasks>\n{rest}<modes>{modes or '<mode name=' + repr('a') + '/>'}</modes></task-model>"
    return times(size, tasks, begin, end)


def schedule(size, jobs="", rest=""):
    begin = f"<schedule xmlns='{SCHEDULE}' model='m'>\n<mode name='a' hyperperiod='10ms' status='valid'>\n"
    return times(size, jobs, begin, f"{rest}</mode></schedule>")


def arxml(size, elements, before="", after=""):
    begin = f"<AUTOSAR xmlns='{ARXML}'><AR-PACKAGES><AR-PACKAGE><SHORT-NAME>p</SHORT-NAME><ELEMENTS>\n{before}"
    return times(size, elements, begin, f"{after}</ELEMENTS></AR-PACKAGE></AR-PACKAGES></AUTOSAR>")


def amalthea(size, tasks, rest=""):
    begin = "<am:Amalthea xmlns:am='http://app4mc.eclipse.org/amalthea/3.3.0' xmlns:xmi='http://www.omg.org/XMI' "
    begin += "xmlns:xsi='http://www.w3.org/2001/XMLSchema-instance' xmi:version='2.0'>\n<swModel>\n"
    return times(size, tasks, begin, f"</swModel>{rest}</am:Amalthea>")


VALIDATE, SHOW = ["validate", "FILE"], ["show", "FILE"]
IMPORT = {kind: ["import", kind, "FILE", "-o", "out.xml"] for kind in ("arxml", "ros", "amalthea")}
OVERLAY = ["import", "ros", "tiny.dot", "--overlay", "FILE", "-o", "out.xml"]
RUN, COMPARE = ["run", "FILE"], ["compare", "s.xml", "FILE"]
PLATFORM = ["export", "regulator", "model.xml", "s.xml", "--platform", "FILE", "-o", "out"]
CALIBRATE = ["import", "ros", "tiny.dot", "--calibrate", "FILE", "-o", "out.xml"]
TASK = "<task name='t{i}' period='10ms'><version name='v' wcet='1us'><run-on unit='u'/></version></task>\n"

WORST = {
    # native
    "model: unknown attributes": (VALIDATE, "m.xml", lambda n: times(n, "a{i}='1' ", f"<task-model xmlns='{MODEL}' ", "/>")),
    "model: unknown elements": (VALIDATE, "m.xml", lambda n: model(n, "<zz/>")),
    "model: bad values": (VALIDATE, "m.xml", lambda n: model(n, "<task name='t{i}' period='soon'/>\n")),
    "model: one bad value at the end": (
        VALIDATE, "m.xml", lambda n: model(n, "<task name='t{i}' period='1ms'/>\n").replace("</tasks>", "<task/></tasks>"),
    ),
    "model: one name for all": (VALIDATE, "m.xml", lambda n: model(n, "<task name='t' period='1ms'/>\n")),
    "model: unlike periods": (VALIDATE, "m.xml", lambda n: model(n, "<task name='t{i}' period='1{i}7/3ms'/>\n")),
    "model: dangling names": (
        VALIDATE, "m.xml", lambda n: model(n, "<task name='t{i}' period='1ms'><version name='v' wcet='1us' units='x{i}'/></task>\n"),
    ),
    "model: a long value": (VALIDATE, "m.xml", lambda n: model(0, f"<task name='{'x' * n}' period='1ms'/>")),
    "model: long digits": (VALIDATE, "m.xml", lambda n: model(n, f"<task name='t{{i}}' period='0.{'1' * 29}ms'/>\n")),
    "model: depth": (VALIDATE, "m.xml", lambda n: "<a>" * (n // 7) + "</a>" * (n // 7)),
    "model: comments": (VALIDATE, "m.xml", lambda n: times(n, "<!-- {i} -->") + "<a/>"),
    "model: processing": (VALIDATE, "m.xml", lambda n: times(n, "<?a?>") + "<!DOCTYPE a><a/>"),
    "schedule: jobs": (SHOW, "x.xml", lambda n: schedule(n, "<job task='t{i}' index='0' start='0ms' end='1ms' version='v' units='u{i}'/>\n")),
    "schedule: unknown": (SHOW, "x.xml", lambda n: schedule(n, "<job tusk='t{i}'/>\n")),
    # ARXML
    "arxml: unknown elements": (IMPORT["arxml"], "a.arxml", lambda n: arxml(n, "<ZZ><SHORT-NAME>z{i}</SHORT-NAME></ZZ>")),
    "arxml: same paths": (IMPORT["arxml"], "a.arxml", lambda n: arxml(n, "<APPLICATION-SW-COMPONENT-TYPE><SHORT-NAME>c</SHORT-NAME></APPLICATION-SW-COMPONENT-TYPE>")),
    "arxml: dangling references": (
        IMPORT["arxml"], "a.arxml",
        lambda n: arxml(n, "<RUNNABLE-ENTITY><SHORT-NAME>r{i}</SHORT-NAME><X-REF DEST='Y'>/no/r{i}</X-REF></RUNNABLE-ENTITY>"),
    ),
    "arxml: packages": (IMPORT["arxml"], "a.arxml", lambda n: times(n, "<AR-PACKAGE><SHORT-NAME>p{i}</SHORT-NAME></AR-PACKAGE>", f"<AUTOSAR xmlns='{ARXML}'><AR-PACKAGES>", "</AR-PACKAGES></AUTOSAR>")),
    # AMALTHEA
    "amalthea: tasks": (IMPORT["amalthea"], "a.amxmi", lambda n: amalthea(n, "<tasks name='t{i}' stimuli='s{i}?type=PeriodicStimulus'/>\n")),
    "amalthea: unknown": (IMPORT["amalthea"], "a.amxmi", lambda n: amalthea(n, "<zz name='t{i}'/>\n")),
    "amalthea: one name": (IMPORT["amalthea"], "a.amxmi", lambda n: amalthea(n, "<tasks name='t'/>\n")),
    # YAML
    "yaml: unknown keys": (RUN, "p.yaml", lambda n: times(n, "k{i}: 1\n", "halpipe-pipeline: 1\n")),
    "yaml: a list": (RUN, "p.yaml", lambda n: times(n, "- {i}\n", "halpipe-pipeline: 1\nexports:\n")),
    "yaml: depth": (RUN, "p.yaml", lambda n: "[" * n),
    "yaml: one text": (RUN, "p.yaml", lambda n: "halpipe-pipeline: 1\nmodel: [" + "x" * n + "]\n"),
    "yaml: aliases": (RUN, "p.yaml", lambda n: "a: &a [1,2,3,4,5,6,7,8,9]\n" + "".join(f"b{i}: &b{i} [{','.join(['*a' if not i else f'*b{i - 1}'] * 9)}]\n" for i in range(20))),
    "yaml: anchors": (RUN, "p.yaml", lambda n: times(n, "k{i}: &a{i} x\n", "halpipe-pipeline: 1\n")),
    "overlay: unknown tasks": (OVERLAY, "o.yaml", lambda n: times(n, "  t{i}: {wcet: 1ms}\n", "halpipe-overlay: 1\ntasks:\n")),
    "overlay: patterns": (OVERLAY, "o.yaml", lambda n: times(n, "  '*{i}*': {wcet: 1ms}\n", "halpipe-overlay: 1\ntasks:\n")),
    "overlay: wild pattern": (OVERLAY, "o.yaml", lambda n: "halpipe-overlay: 1\ntasks:\n  '" + "*a" * (n // 2) + "b': {wcet: 1ms}\n"),
    "overlay: unknown keys": (OVERLAY, "o.yaml", lambda n: times(n, " k{i}: 1,", "halpipe-overlay: 1\ntasks: {t: {", "}}\n")),
    "platform: units": (PLATFORM, "p.yaml", lambda n: times(n, "  u{i}: {manager: {i}}\n", "halpipe-regulator: 1\nunits:\n")),
    # ROS
    "caret: callbacks": (
        IMPORT["ros"], "a.yaml",
        lambda n: times(n, "  - {callback_name: /n/c{i}, callback_type: timer_callback, period_ns: 1{i}0}\n", "named_paths: []\nexecutors: []\nnodes:\n- node_name: /n\n  callbacks:\n"),
    ),
    "caret: nodes": (IMPORT["ros"], "a.yaml", lambda n: times(n, "- {node_name: /n{i}, publishes: [{topic_name: /t}], subscribes: [{topic_name: /t}]}\n", "named_paths: []\nexecutors: []\nnodes:\n")),
    "caret: dangling": (IMPORT["ros"], "a.yaml", lambda n: times(n, "  - {topic_name: /t{i}, callback_names: [/n/x{i}]}\n", "named_paths: []\nexecutors: []\nnodes:\n- node_name: /n\n  callbacks:\n" + times(n // 4, "  - {callback_name: /n/c{i}, callback_type: timer_callback, period_ns: 1000}\n") + "  publishes:\n")),
    "dot: edges": (IMPORT["ros"], "a.dot", lambda n: times(n, "a{i} -> b;\n", "digraph {\n", "}\n")),
    "dot: a ring": (IMPORT["ros"], "a.dot", lambda n: times(n, "a{i} -> a1{i};\n", "digraph {\n", "}\n")),
    "dot: depth": (IMPORT["ros"], "a.dot", lambda n: "digraph " + "{" * n),
    "dot: a string": (IMPORT["ros"], "a.dot", lambda n: 'digraph { "' + "x" * n),
    "dot: comments": (IMPORT["ros"], "a.dot", lambda n: "digraph { " + "/*" * (n // 2)),
    "calibrate: rows": (CALIBRATE, "c.csv", lambda n: times(n, "/n/c{i},1{i}\n", "callback,duration_ns\n")),
    # traces
    "csv: rows": (COMPARE, "t.csv", lambda n: times(n, "t{i},{i}ms,{i}ms\n", "task,start,end\n")),
    "csv: quotes": (COMPARE, "t.csv", lambda n: "task,start,end\n" + '"' * n),
    "btf: events": (COMPARE, "t.btf", lambda n: times(n, "{i},C,0,T,t{i},0,start\n", "#version 2.1.0\n")),
    "trace: events": (COMPARE, "t.json", lambda n: times(n, '{"name":"t{i}","ph":"X","ts":{i},"dur":1,"pid":1,"tid":1},', '{"traceEvents":[', "{}]}")),
    "trace: depth": (COMPARE, "t.json", lambda n: "[" * n),
    "trace: digits": (COMPARE, "t.json", lambda n: '{"traceEvents":[{"ts":' + "1" * n + "}]}"),
}  # fmt: skip

OPEN = {
    "schedule: unknown": "libxml2 reports each of a million violations before one is told; 15 s and 1.3 GiB",
    "caret: dangling": "each publication looks at all callbacks of its node",
    "caret: callbacks": "an odd period is held against all others, some hundred microseconds each",
    "dot: edges": "linear, but several seconds for each megabyte",
    "dot: a ring": "linear, but several seconds for each megabyte",
    "amalthea: tasks": "linear, but about a second for each megabyte",
    "overlay: patterns": "linear, but a second for each megabyte",
}
"""What breaks the cost law at 10 MB still, and why; docs/reference/limits.md says so too."""
