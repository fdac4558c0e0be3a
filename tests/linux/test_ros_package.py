"""The ament package: it compiles against declarations of Humble and Jazzy, and says what is not bound."""

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from ctf_writer import ros_trace
from halpipe.core.bundles import seal
from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.linux.codes import BAD_TEXT
from halpipe.exporters.ros import FORMAT, RosOptions, codes
from halpipe.exporters.ros.packaging import Binding
from halpipe.importers.ros.callbacks import Bound, callbacks_of
from halpipe.models import Part, Split
from support import job, model, ms, schedule, task, version

STUBS = Path(__file__).with_name("ros_stubs")
HUMBLE, JAZZY = 16, 28
BINDINGS = {
    "/source": Binding(node="/source", kind="timer", period=10_000_000),
    "/sink": Binding(node="/sink", kind="subscription", topic="/a"),
}
needs_compiler = pytest.mark.skipif(not shutil.which("g++"), reason="the declarations are checked by g++")


TAKING = """
#include <cstdio>
#include <deque>
#include "table_executor.hpp"

static std::deque<int> through_dds, within;

static std::shared_ptr<void> next(std::deque<int> & queue) {
  if (queue.empty()) {return nullptr;}
  auto found = std::make_shared<int>(queue.front());
  queue.pop_front();
  return found;
}

static rmw_message_info_t state;
rcl_ret_t rcl_timer_get_period(const rcl_timer_t *, int64_t *) {return RCL_RET_OK;}
namespace rclcpp {
rmw_message_info_t & MessageInfo::get_rmw_message_info() {return state;}
#if STUB_RCLCPP >= 28
void Waitable::execute(const std::shared_ptr<void> & data) {std::printf("%d ", *static_cast<int *>(data.get()));}
DeliveredMessageKind SubscriptionBase::get_delivered_message_kind() const {return DeliveredMessageKind::ROS_MESSAGE;}
void Executor::execute_timer(TimerBase::SharedPtr, const std::shared_ptr<void> &) {}
#else
void Executor::execute_timer(TimerBase::SharedPtr) {}
#endif
void Waitable::execute(std::shared_ptr<void> & data) {std::printf("%d ", *static_cast<int *>(data.get()));}
struct Intra : Waitable {std::shared_ptr<void> take_data() override {return next(within);}};
std::shared_ptr<const rcl_timer_t> TimerBase::get_timer_handle() {return nullptr;}
const char * SubscriptionBase::get_topic_name() const {return "/a";}
bool SubscriptionBase::take_type_erased(void * message, MessageInfo &) {
  const auto found = next(through_dds);
  if (found) {*static_cast<int *>(message) = *static_cast<int *>(found.get());}
  return found != nullptr;
}
bool SubscriptionBase::is_serialized() const {return false;}
bool SubscriptionBase::can_loan_messages() const {return false;}
Waitable::SharedPtr SubscriptionBase::get_intra_process_waitable() const {return std::make_shared<Intra>();}
struct Subscription : SubscriptionBase {
  std::shared_ptr<void> create_message() override {return std::make_shared<int>();}
  void handle_message(std::shared_ptr<void> & message, const MessageInfo &) override {
    std::printf("%d ", *static_cast<int *>(message.get()));
  }
  void return_message(std::shared_ptr<void> & message) override {message.reset();}
};
void CallbackGroup::collect_all_ptrs(
  std::function<void(const SubscriptionBase::SharedPtr &)> subscriptions,
  std::function<void(const ServiceBase::SharedPtr &)>, std::function<void(const ClientBase::SharedPtr &)>,
  std::function<void(const TimerBase::SharedPtr &)>, std::function<void(const Waitable::SharedPtr &)>) const
{
  subscriptions(std::make_shared<Subscription>());
}
Executor::Executor(const ExecutorOptions &) {}
void Executor::add_node(std::shared_ptr<Node>, bool) {}
void Executor::execute_subscription(SubscriptionBase::SharedPtr) {}
}  // namespace rclcpp

struct Base : rclcpp::node_interfaces::NodeBaseInterface {
  const char * get_fully_qualified_name() const override {return "/sink";}
  void for_each_callback_group(const std::function<void(rclcpp::CallbackGroup::SharedPtr)> & call) override {
    call(std::make_shared<rclcpp::CallbackGroup>());
  }
};

#include "bindings.hpp"
int main() {
  table::Executor executor(table::takes_newest);
  executor.adopt(std::make_shared<Base>());
  const table::Row row = {"/sink", "/sink", "subscription", "/a", 0, 0};
  if (!executor.bind(&row, 1).empty()) {return 1;}
  for (std::deque<int> * queue : {&through_dds, &within}) {
    *queue = {1, 2, 3};
    while (executor.run(0)) {}
    std::printf("none\\n");
  }
  return table::n_rows == 2 && table::rows[0].task ? 0 : 1;
}
"""


def system():
    tasks = [task(name, 10, version("v", "1ms", "u1")) for name in BINDINGS]
    owner = model(*tasks, units="u1", name="Demo 1".replace(" ", "-"))
    return owner, schedule(owner, 10, job(owner, "/source", 0, 0, "u1"), job(owner, "/sink", 0, 2, "u1"))


def package(bindings=None, owner=None, tables=None, **chosen):
    if owner is None:
        owner, tables = system()
    options = RosOptions(package=True, bindings=BINDINGS if bindings is None else bindings, cpus={"u1": 0}, **chosen)
    return {name: content.decode() for name, content in FORMAT.write(owner, tables, options).items()}


def refusal(**options):
    with pytest.raises(HalpipeError) as caught:
        package(**options)
    return {d.code for d in caught.value.diagnostics}


def compiled(folder, files, distribution):
    """Check the syntax and types of the container; return what the compiler says."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content)
    command = ["g++", "-std=c++17", "-fsyntax-only", "-Wall", "-Wextra", "-Werror", f"-DSTUB_RCLCPP={distribution}"]
    command += [
        "-DPRIORITY=80",
        f"-I{STUBS}",
        f"-I{folder}/src",
        f"-I{folder}/runtime",
        str(folder / "src/container.cpp"),
    ]
    return subprocess.run(command, capture_output=True, text=True, check=False).stderr


@needs_compiler
@pytest.mark.parametrize("distribution", [HUMBLE, JAZZY])
def test_the_container_compiles(tmp_path, distribution):
    assert compiled(tmp_path, package(), distribution) == ""


@needs_compiler
@pytest.mark.parametrize("distribution", [HUMBLE, JAZZY])
@pytest.mark.parametrize("messages", ["oldest", "newest"])
def test_a_job_gets_the_message_that_was_chosen(tmp_path, distribution, messages):
    """Run the executor with the declarations filled in: three messages wait, through DDS and within a process."""
    files = package(messages=messages)
    (tmp_path / "probe.cpp").write_text(TAKING)
    assert compiled(tmp_path, files, distribution) == ""
    command = ["g++", "-std=c++17", f"-DSTUB_RCLCPP={distribution}", f"-I{STUBS}", f"-I{tmp_path}/src"]
    command += ["-o", str(tmp_path / "probe"), str(tmp_path / "probe.cpp")]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.stderr == ""
    ran = subprocess.run([str(tmp_path / "probe")], capture_output=True, text=True, check=True)
    first = "1 2 3 none" if messages == "oldest" else "3 none"
    assert ran.stdout.split("\n") == [first, first, ""]


@needs_compiler
@pytest.mark.parametrize(("distribution", "condition"), [(HUMBLE, "1"), (JAZZY, "0")])
def test_the_timer_of_the_other_distribution_does_not_compile(tmp_path, distribution, condition):
    files = package()
    files["src/table_executor.hpp"] = files["src/table_executor.hpp"].replace("RCLCPP_VERSION_GTE(28, 0, 0)", condition)
    assert "execute_timer" in compiled(tmp_path, files, distribution)


SIGNATURES = {
    "rclcpp/rclcpp.hpp": [
        "virtual void spin() = 0",
        "explicit Executor(const ExecutorOptions & options = ExecutorOptions())",
        "static void execute_subscription(SubscriptionBase::SharedPtr subscription)",
        "static void execute_timer(TimerBase::SharedPtr timer)",
        "static void execute_timer(TimerBase::SharedPtr timer, const std::shared_ptr<void> & data_ptr)",
        "virtual bool call() = 0",
        "virtual std::shared_ptr<void> call() = 0",
        "virtual void execute_callback() = 0",
        "virtual void execute_callback(const std::shared_ptr<void> & data) = 0",
        "bool take_type_erased(void * message_out, MessageInfo & message_info_out)",
        "virtual void handle_message(std::shared_ptr<void> & message, const MessageInfo & message_info) = 0",
        "virtual void return_message(std::shared_ptr<void> & message) = 0",
        "virtual std::shared_ptr<void> create_message() = 0",
        "Waitable::SharedPtr get_intra_process_waitable() const",
        "DeliveredMessageKind get_delivered_message_kind() const",
        "virtual const char * get_fully_qualified_name() const = 0",
        "virtual void for_each_callback_group(const std::function<void(CallbackGroup::SharedPtr)> & func) = 0",
        "virtual std::shared_ptr<void> take_data() = 0",
    ],
    "rclcpp_components/component_manager.hpp": [
        "virtual void add_node_to_executor(uint64_t node_id)",
        "virtual void remove_node_from_executor(uint64_t node_id)",
        "virtual rclcpp::NodeOptions create_node_options(const std::shared_ptr<LoadNode::Request> request)",
    ],
    "rcl/timer.h": ["rcl_ret_t rcl_timer_get_period(const rcl_timer_t * timer, int64_t * period)"],
}
"""The public API as both distributions document it; the stubs are to say the same."""


@pytest.mark.parametrize("file", SIGNATURES)
def test_the_stubs_declare_what_the_distributions_do(file):
    text = re.sub(r"\s+", " ", (STUBS / file).read_text())
    assert [signature for signature in SIGNATURES[file] if f"{signature};" not in text] == []


def test_each_program_is_bound_to_one_callback():
    files = package()
    assert '{"/source", "/source", "timer", "", 10000000, 0},' in files["src/bindings.hpp"]
    assert '{"/sink", "/sink", "subscription", "/a", 0, 0},' in files["src/bindings.hpp"]
    assert ".run" not in files["tables.c"]
    stated = yaml.safe_load(files["config/components.yaml"])
    assert [one["node"] for one in stated["components"]] == ["/sink", "/source"]
    assert "<name>demo_1</name>" in files["package.xml"]
    compile(files["launch/tables.launch.py"], "tables.launch.py", "exec")
    assert "parameter services" in files["README.md"]
    assert seal("ros-package", {"a": b""}, {})


def test_tasks_without_a_callback_are_named():
    assert refusal(bindings={"/source": BINDINGS["/source"]}) == {codes.UNBOUND.id}


def test_names_that_are_none_of_ros_are_refused():
    wrong = {**BINDINGS, "/sink": Binding(node='/si"nk', kind="subscription", topic="/a")}
    assert refusal(bindings=wrong) == {BAD_TEXT.id}


def gapped(split):
    """The system with a job of two parts in place of the first one in one piece."""
    owner, tables = system()
    tasks = tuple(replace(t, versions=tuple(replace(v, split=split) for v in t.versions)) for t in owner.tasks)
    [table] = tables.modes
    first, *others = table.jobs
    half, pause = ms("0.5ms"), ms("0.1ms")
    parts = (
        Part(start=first.start, end=first.start + half, executed_from=ms(0), executed_to=half),
        Part(start=first.start + half + pause, end=first.end + pause, executed_from=half, executed_to=half + half),
    )
    apart = replace(first, parts=parts, end=parts[1].end)
    return replace(owner, tasks=tasks), replace(tables, modes=(replace(table, jobs=(apart, *others)),))


def test_a_callback_is_not_held_at_split_points():
    owner, tables = gapped(Split(points=(ms("0.5ms"),)))
    assert refusal(owner=owner, tables=tables) == {codes.SPLIT_CALLBACK.id}
    _, whole = system()
    assert "tables.c" in package(owner=owner, tables=whole)  # no job has a gap, so none must be held


def test_a_callback_may_be_interrupted_anywhere():
    owner, tables = gapped(Split(anywhere=True, max_gaps=1))
    files = package(owner=owner, tables=tables)
    assert "{{0, 0, 1}, }" in files["tables.c"].replace("[] = { {", "{{")


def test_a_trace_says_which_callbacks_the_tasks_are(tmp_path):
    found = callbacks_of([str(ros_trace(3).write(tmp_path))])
    assert found == {
        "/source": Bound("/source", "timer", "", 10_000_000, 0),
        "/sink/callback_0": Bound("/sink", "timer", "", 20_000_000, 0),
        "/sink/callback_1": Bound("/sink", "subscription", "/a", 0, 0),
    }
