// Component container that plays the tables. It loads composable nodes as they are, starts when the callbacks of all rows
// are there, and serves everything else of the nodes in the background lane. Written by halpipe.
#include <sched.h>

#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <future>
#include <list>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "bindings.hpp"
#include "diagnostic_msgs/msg/diagnostic_array.hpp"
#include "diagnostic_msgs/msg/diagnostic_status.hpp"
#include "dispatch.h"
#include "rclcpp/rclcpp.hpp"
#include "rclcpp_components/component_manager.hpp"
#include "std_srvs/srv/trigger.hpp"
#include "table_executor.hpp"
#include "threads.hpp"

namespace {

table::Executor * executor = nullptr;
rclcpp::Clock::SharedPtr simulation;   // that of the container, if it has use_sim_time: its TimeSource follows /clock

int64_t simulated() {return simulation->now().nanoseconds();}

int run(const dispatch_job * job, int64_t at) {
  const table::Result result = executor->run(job->program, at + job->start);
  const int mode = table::rows[job->program].missing;
  if (result == table::Result::no_data && mode >= 0) {dispatch_request(mode);}
  return static_cast<int>(result);
}

class Container : public rclcpp_components::ComponentManager {
public:
  explicit Container(std::shared_ptr<table::Executor> tables)
  : ComponentManager(tables, "table_container"), tables_(tables) {
    options_.priority = static_cast<int>(declare_parameter<int64_t>("priority", PRIORITY));
    options_.stack = 1024 * static_cast<size_t>(declare_parameter<int64_t>("stack_kib", 0));
    options_.capacity = static_cast<size_t>(declare_parameter<int64_t>("events", 4096));
    options_.clock = CLOCK_MONOTONIC;
    options_.may_unlock = 1;
    options_.lead = 300000;
    record_ = declare_parameter<std::string>("record", "");
    record_mib_ = declare_parameter<int64_t>("record_mib", 1024);
    locks_memory_ = declare_parameter<bool>("lock_memory", true);
    are_stated_ = take_overrun(declare_parameter<std::string>("overrun", "")) &&
      take_cpus(declare_parameter<std::string>("cpus", ""));
    for (const std::string & line : declare_parameter("threads", std::vector<std::string>{})) {
      settings_.emplace_back(line);
      if (!settings_.back().wrong.empty()) {refuse(settings_.back(), settings_.back().wrong);}
    }
    bool is_simulated = false;
    get_parameter("use_sim_time", is_simulated);
    if (is_simulated) {
      simulation = get_clock();
      options_.pace = simulated;
    }
    for (int i = 0; i < plan.n_modes; i++) {
      const auto ask = [i](
        const std::shared_ptr<std_srvs::srv::Trigger::Request>, std::shared_ptr<std_srvs::srv::Trigger::Response> answer) {
        dispatch_request(i);
        answer->success = true;
      };
      modes_.push_back(create_service<std_srvs::srv::Trigger>("~/mode/" + table::mode_names[i], ask));
    }
    diagnostics_ = create_publisher<diagnostic_msgs::msg::DiagnosticArray>("/diagnostics", 10);
    if (const int64_t ms = declare_parameter<int64_t>("status_ms", 100); ms > 0) {
      status_ = create_publisher<diagnostic_msgs::msg::DiagnosticStatus>("~/status", 10);
      tell_status_ = create_wall_timer(std::chrono::milliseconds(ms), [this] {tell_status();});
    }
    look_ = create_wall_timer(std::chrono::milliseconds(200), [this] {look();});
    report_ = create_wall_timer(std::chrono::seconds(1), [this] {report();});
  }

  ~Container() override {
    for (auto & one : own_lanes_) {end(one);}
  }

  // Stop at the end of the table, and return the exit status; end the process where a job that still runs may use any node.
  int finish() {
    if (!is_started_) {
      RCLCPP_ERROR(get_logger(), "the tables never began");
      return DISPATCH_INCOMPLETE;
    }
    dispatch_stop();
    const bool has_ended = dispatch_wait(5) == 0;
    if (dispatch_finish()) {RCLCPP_ERROR(get_logger(), "%s cannot be written", record_.c_str());}
    tell_news();
    if (!has_ended) {
      std::fprintf(stderr, "a job does not return; the process ends without it\n");
      std::_Exit(dispatch_status());
    }
    return dispatch_status();
  }

protected:
  rclcpp::NodeOptions create_node_options(const std::shared_ptr<LoadNode::Request> request) override {
    asks_simulated_ = false;
    for (const auto & one : request->parameters) {asks_simulated_ |= one.name == "use_sim_time" && one.value.bool_value;}
    return ComponentManager::create_node_options(request);
  }

  // Called for the node whose options were created last.
  void add_node_to_executor(uint64_t id) override {
    const auto node = node_wrappers_.at(id).get_node_base_interface();
    if (tables_->has_rows(node->get_fully_qualified_name())) {compare_clocks(node->get_fully_qualified_name());}
    tables_->adopt(node);
    node->for_each_callback_group([&](rclcpp::CallbackGroup::SharedPtr group) {
      if (group->automatically_add_to_executor_with_node()) {take_group(id, node, group);}
    });
    ComponentManager::add_node_to_executor(id);   // all groups that have no lane of their own
  }

  void on_unload_node(
    const std::shared_ptr<rmw_request_id_t> header, const std::shared_ptr<UnloadNode::Request> request,
    std::shared_ptr<UnloadNode::Response> response) override
  {
    const auto found = node_wrappers_.find(request->unique_id);
    if (is_started_ && found != node_wrappers_.end() &&
      tables_->has_rows(found->second.get_node_base_interface()->get_fully_qualified_name()))
    {
      response->success = false;
      response->error_message = "the tables run callbacks of this node; stop the container first";
      RCLCPP_ERROR(get_logger(), "%s", response->error_message.c_str());
      return;
    }
    for (auto & one : own_lanes_) {
      if (one.node == request->unique_id) {end(one);}
    }
    ComponentManager::on_unload_node(header, request, response);
  }

private:
  struct OwnLane {
    uint64_t node;
    std::shared_ptr<table::Lane> lane;
    std::thread thread;
  };

  static void end(OwnLane & one) {
    one.lane->cancel();
    if (one.thread.joinable()) {one.thread.join();}
  }

  void refuse(const table::Setting & setting, const std::string & why) {
    RCLCPP_ERROR(get_logger(), "%s: %s: %s", setting.place.c_str(), setting.id.c_str(), why.c_str());
    are_stated_ = false;
  }

  // A group of the file has a thread of its own, but for one with rows, which the threads of their tasks run.
  void take_group(
    uint64_t id, const rclcpp::node_interfaces::NodeBaseInterface::SharedPtr & node, const rclcpp::CallbackGroup::SharedPtr & group)
  {
    group_ids_.push_back(table::id_of(node->get_fully_qualified_name(), *group));
    for (auto & setting : settings_) {
      if (setting.id != group_ids_.back() || !setting.wrong.empty()) {continue;}
      if (setting.is_used) {return refuse(setting, "two callback groups have this ID");}
      setting.is_used = true;
      const auto tasks = tables_->tasks_of(group);
      for (const std::string & task : tasks) {by_task_.emplace(task, &setting);}
      if (tasks.empty() && !setting.is_plain) {open_lane(id, node, group, setting);}
    }
  }

  void open_lane(
    uint64_t id, const rclcpp::node_interfaces::NodeBaseInterface::SharedPtr & node, const rclcpp::CallbackGroup::SharedPtr & group,
    const table::Setting & setting)
  {
    auto lane = std::make_shared<table::Lane>(tables_.get());
    lane->add_callback_group(group, node);
    std::promise<std::string> applied;
    auto why = applied.get_future();
    std::thread thread([lane, &setting, applied = std::move(applied)]() mutable {
      applied.set_value(setting.apply());
      lane->spin();
    });
    const std::string refused = why.get();
    own_lanes_.push_back({id, lane, std::move(thread)});
    if (!refused.empty()) {refuse(setting, refused);}
    else if (setting.is_deadline() || (setting.priority() && setting.priority() >= options_.priority)) {
      RCLCPP_WARN(get_logger(), "%s: %s: comes before the tables on their CPUs, if it may use them: count it in their WCETs",
        setting.place.c_str(), setting.id.c_str());
    }
  }

  // The threads of the tables start at fixed instants, each unit on one CPU, each task at the level of its preemptions.
  void take_tasks() {
    for (auto & setting : settings_) {
      for (int i = 0; i < plan.n_workers; i++) {
        if (setting.id == plan.workers[i].task) {
          setting.is_used = true;
          by_task_.emplace(setting.id, &setting);
        }
      }
    }
    std::map<std::string, int> cpus;
    int priority = 0;
    for (int i = 0; i < plan.n_workers; i++) {
      const auto found = by_task_.find(plan.workers[i].task);
      if (found == by_task_.end() || found->second->is_plain) {continue;}
      const table::Setting & setting = *found->second;
      const int lowest = setting.priority() - plan.workers[i].priority;
      const int cpu = setting.cpus.empty() ? cpus_[static_cast<size_t>(i)] : setting.cpus.front();
      if (!setting.is_fifo()) {
        refuse(setting, "a thread of the tables starts at fixed instants, which SCHED_FIFO keeps and no reservation or other policy does");
      } else if (setting.cpus.size() > 1) {
        refuse(setting, "a thread of the tables has one CPU, that of its unit");
      } else if (lowest < 1 || (priority && priority != lowest)) {
        refuse(setting, "task " + found->first + " is " + std::to_string(plan.workers[i].priority) + " above the lowest of the "
          "tables, whose priority is " + std::to_string(priority ? priority : 1) + (priority ? "" : " or more"));
      } else if (!cpus.emplace(plan.workers[i].unit, cpu).second && cpus[plan.workers[i].unit] != cpu) {
        refuse(setting, std::string("the tasks of unit ") + plan.workers[i].unit + " have different CPUs");
      }
      priority = lowest;
    }
    for (int i = 0; i < plan.n_workers; i++) {
      const auto found = cpus.find(plan.workers[i].unit);
      if (found != cpus.end()) {cpus_[static_cast<size_t>(i)] = found->second;}
    }
    if (priority) {options_.priority = priority;}
  }

  std::vector<std::string> unknown_settings() const {
    std::vector<std::string> found;
    for (const auto & one : settings_) {
      if (one.is_used) {continue;}
      std::string groups;
      for (const std::string & id : group_ids_) {
        if (id.substr(0, id.find('@')) == one.id.substr(0, one.id.find('@'))) {groups += (groups.empty() ? "; its node has " : ", ") + id;}
      }
      found.push_back(one.place + ": there is no callback group or task " + one.id + groups);
    }
    return found;
  }

  // A simulator may run faster, slower or pause: tables of the machine's clock would run another number of jobs.
  void compare_clocks(const char * node) {
    if (asks_simulated_ && !options_.pace) {
      RCLCPP_ERROR(get_logger(), "%s: use_sim_time: the tables have the machine's clock; state it for the container, too", node);
      are_stated_ = false;
    } else if (!asks_simulated_ && options_.pace) {
      RCLCPP_WARN(get_logger(), "%s: without use_sim_time, as the tables have it, its now() is that of the machine", node);
    }
  }

  int mode_of(const std::string & name) {
    for (int i = 0; i < plan.n_modes; i++) {
      if (name == plan.tables[i].name) {return i;}
    }
    return -1;
  }

  bool take_overrun(const std::string & text) {
    options_.policy = text == "skip" ? DISPATCH_SKIP : DISPATCH_LOG;
    options_.refuge = text.empty() ? DISPATCH_BY_RULES : DISPATCH_NOWHERE;
    if (text.rfind("switch=", 0) == 0) {
      options_.policy = DISPATCH_SWITCH;
      options_.refuge = mode_of(text.substr(7));
    }
    const bool is_known = text.empty() || text == "log" || text == "skip" || options_.refuge >= 0;
    if (!is_known) {RCLCPP_ERROR(get_logger(), "overrun is log, skip or switch=MODE, not %s", text.c_str());}
    return is_known;
  }

  // unit=cpu,unit=cpu; the others keep the CPUs of the export.
  bool take_cpus(const std::string & text) {
    std::istringstream pairs(text);
    std::map<std::string, int> stated;
    for (std::string pair; std::getline(pairs, pair, ',');) {
      const size_t sign = pair.find('=');
      const int cpu = sign == std::string::npos ? -1 : static_cast<int>(table::number_in(pair.substr(sign + 1), 0, CPU_SETSIZE - 1));
      if (cpu < 0 || !stated.emplace(pair.substr(0, sign), cpu).second) {
        RCLCPP_ERROR(get_logger(), "cpus is UNIT=CPU,..., each unit once, not %s", pair.c_str());
        return false;
      }
    }
    std::map<std::string, int> unused = stated;
    for (int i = 0; i < plan.n_workers; i++) {
      const auto found = stated.find(plan.workers[i].unit);
      cpus_.push_back(found == stated.end() ? plan.workers[i].cpu : found->second);
      unused.erase(plan.workers[i].unit);
    }
    for (const auto & one : unused) {RCLCPP_ERROR(get_logger(), "cpus: there is no unit %s", one.first.c_str());}
    return unused.empty();
  }

  // Nodes come, and lifecycle nodes create their callbacks, in their own time.
  void look() {
    const std::vector<std::string> ambiguous = tables_->bind();
    if (is_started_) {
      tell_news();
      if (dispatch_has_ended()) {
        RCLCPP_ERROR(get_logger(), "the tables have ended after a failure");
        rclcpp::shutdown();
      }
      return;
    }
    if (!are_stated_ || !ambiguous.empty()) {
      say_now_and_then("the tables are not played", ambiguous);
      return;
    }
    const std::vector<std::string> lacking = tables_->unbound();
    if (lacking.empty() && !has_taken_tasks_) {
      has_taken_tasks_ = true;
      return take_tasks();
    }
    if (const auto unknown = unknown_settings(); lacking.empty() && !unknown.empty()) {
      return say_now_and_then("the tables are not played", unknown);
    }
    if (lacking.empty() && options_.pace && options_.pace() <= 0) {say_now_and_then("the tables wait for /clock", {});}
    else if (lacking.empty()) {start();}
    else {say_now_and_then("the tables wait for the callbacks of", lacking);}
  }

  void say_now_and_then(const char * what, const std::vector<std::string> & list) {
    if (looks_++ % 25 != 0) {return;}   // 5 s
    std::string all;
    for (const std::string & one : list) {all += (all.empty() ? ": " : "; ") + one;}
    RCLCPP_ERROR(get_logger(), "%s%s", what, all.c_str());
  }

  void start() {
    for (const std::string & one : tables_->others()) {
      RCLCPP_WARN(get_logger(), "no row, so it runs in the background lane: %s", one.c_str());
    }
    options_.cpus = cpus_.data();
    dispatch_hook(run, nullptr);
    if (locks_memory_ && dispatch_lock()) {RCLCPP_WARN(get_logger(), "memory is not locked (RLIMIT_MEMLOCK)");}
    const uint64_t limit = static_cast<uint64_t>(record_mib_) << 20;
    const int error = !record_.empty() && !is_recording_ ? dispatch_record(record_.c_str(), limit) : 0;
    is_recording_ = !error;
    const int refused = error ? error : dispatch_start(&options_);
    if (refused) {
      const char * help = refused == EPERM ? "give this process CAP_SYS_NICE, or ulimit -r 98; priority:=0 does without" : "";
      RCLCPP_ERROR(get_logger(), "%s: %s %s", dispatch_reason, std::strerror(refused), help);
      rclcpp::shutdown();
      return;
    }
    is_started_ = true;
    RCLCPP_INFO(get_logger(), "the tables are played by %d threads", plan.n_workers);
  }

  void tell_news() {
    char text[256];
    while (dispatch_news(text, sizeof text)) {RCLCPP_ERROR(get_logger(), "%s", text);}
  }

  // State what each task did so far, once a second.
  void report() {
    if (!is_started_) {return;}
    diagnostic_msgs::msg::DiagnosticArray all;
    all.header.stamp = now();
    for (int i = 0; i < plan.n_workers; i++) {
      dispatch_counts counts = dispatch_counted(i);
      counts.lost_tables += dispatch_left_out();
      all.status.push_back(status_of(plan.workers[i].task, plan.workers[i].unit, counts));
    }
    diagnostics_->publish(all);
  }

  // State what all of them did, every status_ms.
  void tell_status() {
    if (is_started_) {status_->publish(status_of("all tasks", plan.model, dispatch_total()));}
  }

  diagnostic_msgs::msg::DiagnosticStatus status_of(const std::string & what, const char * hardware, const dispatch_counts & c) {
    using diagnostic_msgs::msg::DiagnosticStatus;
    DiagnosticStatus status;
    status.name = std::string(get_name()) + ": " + what;
    status.hardware_id = hardware;
    const bool is_bad = c.is_stuck || c.faults;
    const bool is_odd = c.late_ends || c.overran || c.no_data || c.skipped || c.lost_tables;
    status.level = is_bad ? DiagnosticStatus::ERROR : is_odd ? DiagnosticStatus::WARN : DiagnosticStatus::OK;
    status.message = c.is_stuck ? "a job does not return" : c.faults ? "a job failed" : is_odd ? "late, or without data" : "";
    const auto value = [&status](const char * key, const std::string & text) {
      diagnostic_msgs::msg::KeyValue pair;
      pair.key = key;
      pair.value = text;
      status.values.push_back(pair);
    };
    value("mode", plan.tables[dispatch_table_now()].name);
    value("cycle", std::to_string(dispatch_cycle_now()));
    value("ended late", std::to_string(c.late_ends));
    value("longer than their slots", std::to_string(c.overran));
    value("without a message", std::to_string(c.no_data));
    value("skipped", std::to_string(c.skipped));
    value("failed", std::to_string(c.faults));
    value("tables lost", std::to_string(c.lost_tables));
    return status;
  }

  std::shared_ptr<table::Executor> tables_;
  std::vector<rclcpp::ServiceBase::SharedPtr> modes_;
  rclcpp::Publisher<diagnostic_msgs::msg::DiagnosticArray>::SharedPtr diagnostics_;
  rclcpp::Publisher<diagnostic_msgs::msg::DiagnosticStatus>::SharedPtr status_;
  rclcpp::TimerBase::SharedPtr look_, report_, tell_status_;
  std::vector<int> cpus_;
  dispatch_options options_{};
  std::string record_;
  int64_t record_mib_ = 0;
  unsigned looks_ = 0;
  bool is_started_ = false, is_recording_ = false, locks_memory_ = true, are_stated_ = true;
  bool asks_simulated_ = false, has_taken_tasks_ = false;
  std::list<table::Setting> settings_;
  std::map<std::string, table::Setting *> by_task_;
  std::vector<std::string> group_ids_;
  std::list<OwnLane> own_lanes_;
};

// The background lane and the threads of the middleware, which inherit it, run on these CPUs: --background-cpus 0,3.
// Return whether they could be read.
bool move_to_background(int argc, char ** argv) {
  for (int i = 1; i + 1 < argc; i++) {
    if (std::strcmp(argv[i], "--background-cpus") != 0) {continue;}
    const std::vector<int> cpus = table::cpus_in(argv[i + 1]);
    if (cpus.empty()) {
      std::fprintf(stderr, "--background-cpus is CPU,..., not %s\n", argv[i + 1]);
      return false;
    }
    if (table::move_to(cpus)) {std::perror("--background-cpus");}
  }
  return true;
}

}  // namespace

int main(int argc, char ** argv) {
  if (!move_to_background(argc, argv)) {return 1;}
  rclcpp::init(argc, argv);
  auto tables = std::make_shared<table::Executor>(table::rows, table::n_rows, table::takes_newest);
  executor = tables.get();
  auto container = std::make_shared<Container>(tables);
  tables->add_node(container);
  tables->spin();
  const int status = container->finish();
  tables->remove_node(container);
  container.reset();
  rclcpp::shutdown();
  return status;
}
