"""Writes small traces in CTF 1.8 by the specification, so that tests know every byte of them."""

import struct

BASE = """/* CTF 1.8 */
typealias integer {{ size = 8; align = {align}; signed = false; }} := uint8_t;
typealias integer {{ size = 16; align = {align}; signed = false; }} := uint16_t;
typealias integer {{ size = 32; align = {align}; signed = false; }} := uint32_t;
typealias integer {{ size = 64; align = {align}; signed = false; }} := uint64_t;
typealias integer {{ size = 27; align = 1; signed = false; }} := uint27_t;
trace {{
  major = 1; minor = 8; byte_order = {order};
  packet.header := struct {{ uint32_t magic; uint32_t stream_id; }};
}};
clock {{ name = "monotonic"; freq = 1000000000; offset = {offset}; }};
struct large {{
  enum : uint16_t {{ compact = 0 ... 65534, extended = 65535 }} id;
  variant <id> {{
    struct {{ uint32_t timestamp; }} compact;
    struct {{ uint32_t id; uint64_t timestamp; }} extended;
  }} v;
}} align(8);
struct small {{
  enum : integer {{ size = 5; align = 1; signed = false; }} {{ compact = 0 ... 30, extended = 31 }} id;
  variant <id> {{
    struct {{ uint27_t timestamp; }} compact;
    struct {{ uint32_t id; uint64_t timestamp; }} extended;
  }} v;
}} align(8);
stream {{
  id = 0;
  event.header := struct {header};
  packet.context := struct {{
    uint64_t timestamp_begin; uint64_t timestamp_end; uint64_t content_size; uint64_t packet_size;
    uint64_t events_discarded; uint32_t cpu_id;
  }};
  event.context := struct {{ uint32_t _vpid; uint32_t _vtid; }};
}};
"""
TYPES = {"u64": "uint64_t", "u32": "uint32_t", "str": "string"}
CODES = {"u64": "Q", "u32": "I"}


class Trace:
    """Collects events and writes them, each CPU to a stream of its own; times are nanoseconds since `offset`."""

    def __init__(self, order="le", header="large", offset=1_000_000):
        self.mark = "<" if order == "le" else ">"
        self.header, self.offset = header, offset
        self.text = BASE.format(align=8, order=order, header=header, offset=offset)
        self.classes = {}
        self.streams = {}

    def declare(self, name, **fields):
        """Declare a class of events; `fields` have the types u32, u64 or str."""
        id = len(self.classes)
        self.classes[name] = (id, fields)
        body = " ".join(f"{TYPES[type]} _{field};" for field, type in fields.items())
        self.text += f'event {{ name = "{name}"; id = {id}; stream_id = 0; fields := struct {{ {body} }}; }};\n'

    def add(self, name, time, cpu=0, pid=7, tid=8, **values):
        """Add an event to the current packet of a CPU."""
        id, fields = self.classes[name]
        data = struct.pack(f"{self.mark}II", pid, tid)
        for field, type in fields.items():
            value = values[field]
            data += value.encode() + b"\0" if type == "str" else struct.pack(self.mark + CODES[type], value)
        self.streams.setdefault(cpu, [[]])[-1].append((time, id, data))

    def next_packet(self, cpu=0):
        self.streams.setdefault(cpu, [[]]).append([])

    def event(self, time, id, data, extended):
        mark = self.mark
        if self.header == "large":
            head = (
                struct.pack(f"{mark}HIQ", 65535, id, time)
                if extended
                else struct.pack(f"{mark}HI", id, time & 0xFFFFFFFF)
            )
        elif extended:
            head = bytes([31 if mark == "<" else 31 << 3]) + struct.pack(f"{mark}IQ", id, time)
        else:
            low = time & 0x7FFFFFF
            head = struct.pack(f"{mark}I", id | low << 5 if mark == "<" else id << 27 | low)
        return head + data

    def packet(self, cpu, events, discarded=0, extended=False):
        body = b"".join(self.event(*event, extended) for event in events)
        begin = events[0][0] if events else 0
        end = events[-1][0] if events else 0
        size = 8 + 44 + len(body)
        padded = size + 16
        head = struct.pack(f"{self.mark}II", 0xC1FC1FC1, 0)
        context = struct.pack(f"{self.mark}QQQQQI", begin, end, 8 * size, 8 * padded, discarded, cpu)
        return head + context + body + bytes(16)

    def write(self, folder, discarded=0, extended=False):
        """Write the trace; the last packet of each stream states `discarded` events."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "metadata").write_text(self.text)
        for cpu, packets in self.streams.items():
            ordered = iter(sorted((event for packet in packets for event in packet), key=lambda event: event[0]))
            packets = [[next(ordered) for _ in packet] for packet in packets]
            lost = [0] * (len(packets) - 1) + [discarded]
            data = [self.packet(cpu, events, n, extended) for events, n in zip(packets, lost, strict=True)]
            (folder / f"channel_{cpu}").write_bytes(b"".join(data))
        return folder


ROS = {
    "ros2:rcl_node_init": {"node_handle": "u64", "rmw_handle": "u64", "node_name": "str", "namespace": "str"},
    "ros2:rcl_publisher_init": {"publisher_handle": "u64", "node_handle": "u64", "topic_name": "str"},
    "ros2:rcl_subscription_init": {"subscription_handle": "u64", "node_handle": "u64", "topic_name": "str"},
    "ros2:rclcpp_subscription_init": {"subscription_handle": "u64", "subscription": "u64"},
    "ros2:rclcpp_subscription_callback_added": {"subscription": "u64", "callback": "u64"},
    "ros2:rcl_timer_init": {"timer_handle": "u64", "period": "u64"},
    "ros2:rclcpp_timer_callback_added": {"timer_handle": "u64", "callback": "u64"},
    "ros2:rclcpp_timer_link_node": {"timer_handle": "u64", "node_handle": "u64"},
    "ros2:callback_start": {"callback": "u64", "is_intra_process": "u32"},
    "ros2:callback_end": {"callback": "u64"},
    "ros2:rcl_publish": {"publisher_handle": "u64", "message": "u64"},
    "ros2_caret:construct_executor": {"executor_addr": "u64", "executor_type_name": "str"},
    "ros2_caret:add_callback_group": {"executor_addr": "u64", "callback_group_addr": "u64", "group_type_name": "str"},
    "ros2_caret:callback_group_add_timer": {"callback_group_addr": "u64", "timer_handle": "u64"},
    "ros2_caret:callback_group_add_subscription": {"callback_group_addr": "u64", "subscription_handle": "u64"},
    "sched_switch": {"prev_tid": "u32", "next_tid": "u32"},
    "other:thing": {"value": "u32"},
}
MS = 1_000_000


def ros_trace(rounds=20, switches=False, sends=None, **options):
    """/source: a timer of 10 ms publishes /a. /sink keeps /a in one callback; its timer of 20 ms publishes /b.

    With `sends`, the timer of the sink runs in so many of its rounds, from the first on.

    Job k of the source lasts 1 ms + k us; each job of the sink's timer 3 ms, of which another thread takes 1 ms.
    """
    trace = Trace(**options)
    for name, fields in ROS.items():
        trace.declare(name, **fields)
    add = trace.add
    for node, (handle, name) in enumerate(((1, "source"), (2, "sink"))):
        add("ros2:rcl_node_init", node, node_handle=handle, rmw_handle=0, node_name=name, namespace="/")
    add("ros2:rcl_publisher_init", 3, publisher_handle=10, node_handle=1, topic_name="/a")
    add("ros2:rcl_publisher_init", 4, publisher_handle=20, node_handle=2, topic_name="/b")
    for timer, node, period, callback in ((11, 1, 10 * MS, 100), (21, 2, 20 * MS, 200)):
        add("ros2:rcl_timer_init", 5, timer_handle=timer, period=period)
        add("ros2:rclcpp_timer_callback_added", 6, timer_handle=timer, callback=callback)
        add("ros2:rclcpp_timer_link_node", 7, timer_handle=timer, node_handle=node)
    add("ros2:rcl_subscription_init", 8, subscription_handle=30, node_handle=2, topic_name="/a")
    add("ros2:rclcpp_subscription_init", 9, subscription_handle=30, subscription=31)
    add("ros2:rclcpp_subscription_callback_added", 10, subscription=31, callback=300)
    add("ros2_caret:construct_executor", 11, executor_addr=50, executor_type_name="multi_threaded_executor")
    add(
        "ros2_caret:add_callback_group",
        12,
        executor_addr=50,
        callback_group_addr=60,
        group_type_name="mutually_exclusive",
    )
    add("ros2_caret:callback_group_add_timer", 13, callback_group_addr=60, timer_handle=21)
    add("ros2_caret:callback_group_add_subscription", 14, callback_group_addr=60, subscription_handle=30)
    if switches:
        add("sched_switch", 15, prev_tid=0, next_tid=8)
    for k in range(rounds):
        at = (10 * k + 1) * MS
        trace.next_packet(0)
        add("ros2:callback_start", at, callback=100, is_intra_process=0)
        add("ros2:rcl_publish", at + 500, publisher_handle=10, message=k)
        add("ros2:callback_end", at + MS + 1000 * k, callback=100)
        add("ros2:callback_start", at + 2 * MS, cpu=1, tid=9, callback=300, is_intra_process=0)
        add("ros2:callback_end", at + 2 * MS + 700_000, cpu=1, tid=9, callback=300)
        if k % 2 == 0 and (sends is None or k // 2 < sends):
            add("ros2:callback_start", at + 4 * MS, cpu=1, tid=9, callback=200, is_intra_process=0)
            if switches:
                add("sched_switch", at + 5 * MS, cpu=1, tid=9, prev_tid=9, next_tid=77)
                add("sched_switch", at + 6 * MS, cpu=1, tid=77, prev_tid=77, next_tid=9)
            add("ros2:rcl_publish", at + 6 * MS + 10, cpu=1, tid=9, publisher_handle=20, message=k)
            add("ros2:callback_end", at + 7 * MS, cpu=1, tid=9, callback=200)
    return trace
