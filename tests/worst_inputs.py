"""The worst inputs of each reader, at any size: (command, file, content)."""

from __future__ import annotations

MODEL = "urn:halpipe:task-model:1"
SCHEDULE = "urn:halpipe:schedule:1"
ARXML = "http://autosar.org/schema/r4.0"


def as_bytes(content):
    """Return an input, which is a text or bytes, as bytes."""
    return content if isinstance(content, bytes) else content.encode()


def times(size, piece, before="", after=""):
    """Repeat a piece, with {i} as its number, until the whole has `size` bytes, less than a piece more or less."""
    pieces, left = [], size - len(before) - len(after)
    while piece and (left > 0 or not pieces):
        pieces.append(piece.replace("{i}", str(len(pieces))))
        left -= len(pieces[-1])
    return before + "".join(pieces) + after


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
    stimulus = "<stimuli xsi:type='am:PeriodicStimulus' name='s'><recurrence value='10' unit='ms'/></stimuli>"
    return times(size, tasks, begin, f"</swModel>{rest}<stimuliModel>{stimulus}</stimuliModel></am:Amalthea>")


def varint(value):
    """Return a number of protobuf: seven bits a byte, the lowest first."""
    return bytes([value & 0x7F | 0x80]) + varint(value >> 7) if value > 0x7F else bytes([value])


def message(*fields):
    """Return the fields of a message of protobuf: numbers, or bytes with their length."""
    return b"".join(
        varint(number << 3) + varint(value)
        if isinstance(value, int)
        else varint(number << 3 | 2) + varint(len(value)) + value
        for number, value in fields
    )


def perfetto(size, packets):
    """Repeat packets of Perfetto, those of each number from 0 on, until there are `size` bytes."""
    found, number = bytearray(), 0
    while len(found) < size:
        found += message(*((1, packet) for packet in packets(number)))
        number += 1
    return bytes(found)


def slices(number, track):
    """Return packets that begin and end a slice with a name of its own."""
    name = b"t%d" % (number % 50_000)
    begin, end = message((9, 1), (11, track), (23, name)), message((9, 2), (11, track))
    return [message((8, 2 * number + late), (11, event), (10, 1)) for late, event in enumerate((begin, end))]


def process_track(number):
    """Return packets of a track of a process of its own, with a slice."""
    about = message((1, number + 1), (3, message((1, number + 1), (6, b"p%d" % number))))
    return [message((60, about), (10, 1)), *slices(number, number + 1)]


VALIDATE, SHOW = ["validate", "FILE"], ["show", "FILE"]
IMPORT = {kind: ["import", kind, "FILE", "-o", "out.xml"] for kind in ("arxml", "ros", "amalthea", "table")}
OVERLAY = ["import", "ros", "tiny.dot", "--overlay", "FILE", "-o", "out.xml"]
RUN, COMPARE = ["run", "FILE"], ["compare", "s.xml", "FILE"]
PLATFORM = ["export", "regulator", "model.xml", "s.xml", "--platform", "FILE", "-o", "out"]
CALIBRATE = ["import", "ros", "graph.dot", "--overlay", "graph.yaml", "--calibrate", "FILE", "-o", "out.xml"]
BESIDE = {
    "tiny.dot": "digraph { a -> b; }",
    "graph.dot": 'digraph { "/source" [shape=ellipse]; "/a" [shape=box]; "/source" -> "/a" -> "/sink"; }',
    "graph.yaml": 'halpipe-overlay: 1\nsources: {"/a": {period: 10ms}}\n',
}
"""What commands read besides: as good as can be, so that the input in question is read."""
VERIFY = ["verify", "model.xml", "FILE"]
CARET = "named_paths: []\nexecutors: []\nnodes:\n- node_name: /n\n"
ONE_MODE = "<mode name='a'><run task='t0' versions='v'/></mode>"
UNITS = "<unit name='u'/><resource name='r'/>"
RUNS = "<version name='v' wcet='1us'><units names='u'/>"
ACCESS = "<access resource='r' start='{i}ns' end='1{i}ns' bound='0.{i}1'/>\n"
CHAIN = "<chain name='c{i}' tasks='t0 t0' max-age='1ms'/>\n"
VERSION = f"<task name='t0' period='10ms'>{RUNS}BODY</version></task>"
RUNNABLE = (
    "<runnables name='r{i}'><activityGraph>"
    + 2 * "<items xsi:type='am:RunnableCall' runnable='r{j}?type=Runnable'/>"
    + "</activityGraph></runnables>\n"
)
TASK = "<task name='t{i}' period='10ms'><version name='v' wcet='1us'><units names='u'/></version></task>\n"

READERS = {
    *(
        "model",
        "schedule",
        "arxml",
        "amalthea",
        "yaml",
        "overlay",
        "platform",
        "caret",
        "dot",
        "csv",
        "btf",
        "perfetto",
    ),
}
"""What reads files that others write."""

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
        VALIDATE, "m.xml", lambda n: model(n, "<task name='t{i}' period='1ms'><version name='v' wcet='1us'><units names='x{i}'/></version></task>\n"),
    ),
    "model: a long value": (VALIDATE, "m.xml", lambda n: model(0, f"<task name='{'x' * n}' period='1ms'/>")),
    "model: long digits": (VALIDATE, "m.xml", lambda n: model(n, f"<task name='t{{i}}' period='0.{'1' * 29}ms'/>\n")),
    "model: depth": (VALIDATE, "m.xml", lambda n: "<a>" * (n // 7) + "</a>" * (n // 7)),
    "model: comments": (VALIDATE, "m.xml", lambda n: times(n, "<!-- {i} -->") + "<a/>"),
    "model: processing": (VALIDATE, "m.xml", lambda n: times(n, "<?a?>") + "<!DOCTYPE a><a/>"),
    "schedule: jobs": (SHOW, "x.xml", lambda n: schedule(n, "<job task='t{i}' index='0' start='0ms' end='1ms' version='v' units='u{i}'/>\n")),
    "schedule: unknown": (SHOW, "x.xml", lambda n: schedule(n, "<job tusk='t{i}'/>\n")),
    "model: tasks": (VALIDATE, "m.xml", lambda n: model(n, TASK)),
    "model: runs": (VALIDATE, "m.xml", lambda n: model(n // 2, TASK, modes="<mode name='a'>" + times(n // 2, "<run task='t{i}' versions='v'/>\n") + "</mode>")),
    "model: modes": (VALIDATE, "m.xml", lambda n: model(0, TASK, modes=times(n, "<mode name='m{i}'><run task='t0' versions='v'/></mode>\n"))),
    "model: chains": (VALIDATE, "m.xml", lambda n: model(0, TASK, rest=f"<chains>{times(n, CHAIN)}</chains>", modes=ONE_MODE)),
    "model: one long chain": (VALIDATE, "m.xml", lambda n: model(0, TASK, rest=f"<chains><chain name='c' tasks='{'t0 ' * (n // 3)}' max-age='1ms'/></chains>", modes=ONE_MODE)),
    "model: health rules": (VALIDATE, "m.xml", lambda n: model(n // 2, TASK, modes="<mode name='a'>" + times(n // 4, "<run task='t{i}' versions='v'/>\n") + "</mode>").replace("</task-model>", times(n // 4, "<rule task='t{i}' action='restart'/>\n", "<health>", "</health></task-model>"))),
    "model: accesses": (VALIDATE, "m.xml", lambda n: model(0, VERSION.replace("BODY", times(n, ACCESS)), units=UNITS, modes=ONE_MODE)),
    "model: precedences": (VALIDATE, "m.xml", lambda n: model(n, f"<task name='t{{i}}' period='10ms'>{RUNS}<precedence task='t{{i}}0' max='1ms'/></version></task>\n")),
    "model: many precedences": (VALIDATE, "m.xml", lambda n: model(0, VERSION.replace("BODY", times(n, "<precedence task='t0' max='1ms'/>\n")), modes=ONE_MODE)),
    "model: split points": (VALIDATE, "m.xml", lambda n: model(0, VERSION.replace("wcet='1us'", f"wcet='1s' split='{times(n, '{i}ns ')}'").replace("BODY", ""), modes=ONE_MODE)),
    "model: units": (VALIDATE, "m.xml", lambda n: model(0, TASK, units=times(n, "<unit name='u{i}'/>"), modes=ONE_MODE)),
    "model: interrupts": (VALIDATE, "m.xml", lambda n: model(0, TASK, units="<unit name='u'>" + times(n, "<interrupt name='i{i}' distance='1{i}us' wcet='1ns'/>") + "</unit>", modes=ONE_MODE)),
    "model: transitions": (VALIDATE, "m.xml", lambda n: model(0, TASK, modes=ONE_MODE).replace("</task-model>", times(n, "<transition from='a' to='a'/>\n", "<transitions>", "</transitions></task-model>"))),
    "verify: jobs of one task": (VERIFY, "x.xml", lambda n: schedule(n, "<job task='a' index='{i}' start='0ms' end='1ms' version='v' units='u'/>\n")),
    "verify: unlike jobs": (VERIFY, "x.xml", lambda n: schedule(n, "<job task='t{i}' index='0' start='{i}ns' end='1ms' version='v' units='u'/>\n")),
    "verify: parts": (VERIFY, "x.xml", lambda n: schedule(0, "<job task='a' index='0' start='0ms' end='1ms' version='v' units='u'>" + times(n, "<part start='{i}ns' end='1{i}ns' from='{i}ns' to='1{i}ns'/>\n") + "</job>")),
    "verify: unlike ends": (VERIFY, "x.xml", lambda n: schedule(n, "<job task='a' index='{i}' start='{i}ns' end='1{i}1/7ms' version='v' units='u'/>\n")),
    "verify: laps": (VERIFY, "x.xml", lambda n: schedule(n, "<job task='a' index='{i}' start='0ms' end='99999999999999s' version='v' units='u'/>\n")),
    "verify: modes": (VERIFY, "x.xml", lambda n: times(n, "<mode name='a{i}' hyperperiod='10ms' status='valid'/>\n", f"<schedule xmlns='{SCHEDULE}' model='m'>\n", "</schedule>")),
    "verify: transitions": (VERIFY, "x.xml", lambda n: times(n, "<transition from='a' to='a{i}' length='0ms' worst-latency='1ms' status='valid'/>\n", f"<schedule xmlns='{SCHEDULE}' model='m'>\n", "</schedule>")),
    "junit: cases": (
        ["selftest", "--mutants", "1", "--evidence", "out", "--results", "FILE"], "r.xml",
        lambda n: times(n, "<testcase classname='tests.t{i}' name='test_a'><failure/></testcase>", "<testsuite>", "</testsuite>"),
    ),
    # ARXML
    "arxml: unknown elements": (IMPORT["arxml"], "a.arxml", lambda n: arxml(n, "<ZZ><SHORT-NAME>z{i}</SHORT-NAME></ZZ>")),
    "arxml: same paths": (IMPORT["arxml"], "a.arxml", lambda n: arxml(n, "<APPLICATION-SW-COMPONENT-TYPE><SHORT-NAME>c</SHORT-NAME></APPLICATION-SW-COMPONENT-TYPE>")),
    "arxml: dangling references": (
        IMPORT["arxml"], "a.arxml",
        lambda n: arxml(n, "<RUNNABLE-ENTITY><SHORT-NAME>r{i}</SHORT-NAME><X-REF DEST='Y'>/no/r{i}</X-REF></RUNNABLE-ENTITY>"),
    ),
    "arxml: packages": (IMPORT["arxml"], "a.arxml", lambda n: times(n, "<AR-PACKAGE><SHORT-NAME>p{i}</SHORT-NAME></AR-PACKAGE>", f"<AUTOSAR xmlns='{ARXML}'><AR-PACKAGES>", "</AR-PACKAGES></AUTOSAR>")),
    # AMALTHEA
    "table: tasks": (IMPORT["table"], "t.csv", lambda n: times(min(n, 2_400_000), "u{i},10,1000,c0,t0,comment of a row as people write them\n", "Task,Period [ms],WCET [ns],Core,After,Comment\nt0,10,1,c0,,\n")),
    "table: faults": (IMPORT["table"], "t.csv", lambda n: times(min(n, 900_000), "t{i},10,x,c0,tt{i},\n", "Task,Period [ms],WCET [ns],Core,After,Comment\n")),
    "table: columns": (IMPORT["table"], "t.csv", lambda n: times(n, "a,", "", "\n")),
    "amalthea: tasks": (IMPORT["amalthea"], "a.amxmi", lambda n: amalthea(n, "<tasks name='t{i}' stimuli='s{i}?type=PeriodicStimulus'/>\n")),
    "amalthea: unknown": (IMPORT["amalthea"], "a.amxmi", lambda n: amalthea(n, "<zz name='t{i}'/>\n")),
    "amalthea: valid tasks": (IMPORT["amalthea"], "a.amxmi", lambda n: amalthea(n, "<tasks name='t{i}' stimuli='s?type=PeriodicStimulus'/>\n")),
    "amalthea: one name": (IMPORT["amalthea"], "a.amxmi", lambda n: amalthea(n, "<tasks name='t'/>\n")),
    "amalthea: references": (IMPORT["amalthea"], "a.amxmi", lambda n: amalthea(n, "", "") .replace("</swModel>", "<tasks name='t' stimuli='" + times(n, "s{i}?type=PeriodicStimulus ") + "'/></swModel>")),
    "amalthea: runnables": (IMPORT["amalthea"], "a.amxmi", lambda n: amalthea(n, "<runnables name='r{i}'><activityGraph><items xsi:type='am:Ticks'><default xsi:type='am:DiscreteValueConstant' value='1{i}'/></items></activityGraph></runnables>\n")),
    "amalthea: calls": (IMPORT["amalthea"], "a.amxmi", lambda n: amalthea(n, "<items xsi:type='am:RunnableCall' runnable='r?type=Runnable'/>\n").replace("<swModel>", "<swModel><runnables name='r'/><tasks name='t' stimuli='s?type=PeriodicStimulus'><activityGraph>", 1).replace("</swModel>", "</activityGraph></tasks></swModel>")),
    "amalthea: calls in a ring": (IMPORT["amalthea"], "a.amxmi", lambda n: amalthea(n, "<runnables name='r{i}'><activityGraph><items xsi:type='am:RunnableCall' runnable='r1{i}?type=Runnable'/><items xsi:type='am:RunnableCall' runnable='r1{i}?type=Runnable'/></activityGraph></runnables>\n")),
    "amalthea: depth of calls": (IMPORT["amalthea"], "a.amxmi", lambda n: amalthea(0, "".join(RUNNABLE.replace("{i}", str(i)).replace("{j}", str(i + 1)) for i in range(n // 200)) + "<tasks name='t' stimuli='s?type=PeriodicStimulus'><activityGraph><items xsi:type='am:RunnableCall' runnable='r0?type=Runnable'/></activityGraph></tasks>")),
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
    "caret: contexts": (IMPORT["ros"], "a.yaml", lambda n: times(n, "  - {context_type: tilde, subscription_topic_name: /s, publisher_topic_name: /p}\n", CARET + "  callbacks:\n" + times(n // 4, "  - {callback_name: /n/c{i}, callback_type: subscription_callback, topic_name: /s}\n") + "  publishes: [{topic_name: /p}]\n  message_contexts:\n")),
    "caret: subscriptions": (IMPORT["ros"], "a.yaml", lambda n: times(n, "  - {topic_name: /t{i}, callback_name: /n/c0}\n", CARET + "  callbacks: [{callback_name: /n/c0, callback_type: timer_callback, period_ns: 1000000}]\n  subscribes:\n")),
    "caret: members": (IMPORT["ros"], "a.yaml", lambda n: CARET + "  callbacks: [{callback_name: /n/c0, callback_type: timer_callback, period_ns: 1000000}]\n  callback_groups:\n" + times(n, "/n/c0, ", "  - {callback_group_name: g, callback_group_type: reentrant, callback_names: [", "/n/c0]}\n")),
    "caret: paths": (IMPORT["ros"], "a.yaml", lambda n: times(n, "- {path_name: p{i}, node_chain: [{node_name: /n}]}\n", CARET.replace("named_paths: []\n", "") + "  callbacks: []\nnamed_paths:\n")),
    "dot: blocks": (IMPORT["ros"], "a.dot", lambda n: "digraph { {" + times(n // 2, "a{i} ") + "} -> {" + times(n // 2, "b{i} ") + "} }"),
    "dot: vertices": (IMPORT["ros"], "a.dot", lambda n: times(n, "a{i};\n", "digraph {\n", "}\n")),
    "dot: attributes": (IMPORT["ros"], "a.dot", lambda n: times(n, "a{i}=b,", "digraph { a [", "c=d]; a -> b }")),
    "dot: a long label": (IMPORT["ros"], "a.dot", lambda n: 'digraph { a [label="' + "\\n" * (n // 2) + '"]; a -> b }'),
    "dot: html": (IMPORT["ros"], "a.dot", lambda n: "digraph { a [label=" + "<" * n),
    "calibrate: rows": (CALIBRATE, "c.csv", lambda n: times(n, "/n/c{i},1{i}\n", "callback,duration_ns\n")),
    # traces
    "csv: rows": (COMPARE, "t.csv", lambda n: times(n, "t{i},{i},1{i}\n", "task,start,end\n")),
    "csv: quotes": (COMPARE, "t.csv", lambda n: "task,start,end\n" + '"' * n),
    "btf: events": (COMPARE, "t.btf", lambda n: times(n, "{i},C,0,T,t{i},0,start\n", "#version 2.1.0\n")),
    "trace: events": (COMPARE, "t.json", lambda n: times(n, '{"name":"t{i}","ph":"X","ts":{i},"dur":1,"pid":1,"tid":1},', '{"traceEvents":[', "{}]}")),
    "trace: processes": (COMPARE, "t.json", lambda n: times(n, '{"name":"a","ph":"X","ts":{i},"dur":1,"pid":{i},"tid":1},', '{"traceEvents":[', "{}]}")),
    "perfetto: slices": (COMPARE, "t.pftrace", lambda n: perfetto(n, lambda i: slices(i, 1))),
    "perfetto: tracks": (COMPARE, "t.pftrace", lambda n: perfetto(n, lambda i: slices(i, i + 1)[:1])),
    "perfetto: processes": (COMPARE, "t.pftrace", lambda n: perfetto(n, process_track)),
    "perfetto: descriptors": (COMPARE, "t.pftrace", lambda n: perfetto(n, lambda i: process_track(i)[:1])),
    "perfetto: damaged packets": (COMPARE, "t.pftrace", lambda n: perfetto(n, lambda i: [message((60, 5)), *slices(i, 1)])),
    "perfetto: damage at the end": (COMPARE, "t.pftrace", lambda n: perfetto(n, lambda i: slices(i, 1)) + message((1, message((60, 5))))),
    "perfetto: a packet cut off": (COMPARE, "t.pftrace", lambda n: perfetto(n, lambda i: slices(i, 1))[:-3]),
    "btf: a job": (COMPARE, "t.btf", lambda n: times(n, "{i},u,0,T,a,0,start\n{i},u,0,T,a,0,terminate\n", "#version 2.1.0\n#timeScale ns\n")),
    "btf: a late instant": (COMPARE, "t.btf", lambda n: times(n, "{i},u,0,T,a,0,start\n{i},u,0,T,a,0,terminate\n", "#version 2.1.0\n#timeScale ns\n", f"{10**25},u,0,T,a,0,start\n{10**25},u,0,T,a,0,terminate\n")),
    "csv: gaps": (COMPARE, "t.csv", lambda n: times(n, "a,{i}000000000,{i}000000001\n", "task,start,end\n")),
    "csv: one task": (COMPARE, "t.csv", lambda n: times(n, "a,{i},1{i}\n", "task,start,end\n")),
    "csv: columns": (COMPARE, "t.csv", lambda n: times(n, "c{i},", "task,start,end,")),
    "trace: one task": (COMPARE, "t.json", lambda n: times(n, '{"name":"a","ph":"X","ts":{i},"dur":1,"pid":1,"tid":1},', '{"traceEvents":[', "{}]}")),
    "signals: rows": (COMPARE, "t.csv", lambda n: times(n, "{i},0,1\n", "time_us,a,b\n")),
    "ftrace: switches": (COMPARE, "t.txt", lambda n: times(n, "a-1 [000] d... {i}.000001: sched_switch: prev_comm=a prev_pid=1 prev_prio=1 prev_state=S ==> next_comm=b next_pid={i} next_prio=1\n", "# tracer: nop\n")),
    "ftrace: a line": (COMPARE, "t.txt", lambda n: "# tracer: nop\na-1 " + "[0] " * (n // 4) + "1.0: sched_switch: " + "1:1 [1] " * 50 + "\n"),
    "ftrace: digits": (COMPARE, "t.txt", lambda n: "# tracer: nop\n" + "1" * n + "\n"),
    "trace: depth": (COMPARE, "t.json", lambda n: "[" * n),
    "trace: digits": (COMPARE, "t.json", lambda n: '{"traceEvents":[{"ts":' + "1" * n + "}]}"),
}  # fmt: skip
