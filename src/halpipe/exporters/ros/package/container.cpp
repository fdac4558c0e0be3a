// A component container that plays the tables: it loads composable nodes as they are, and starts when all are there.
// Written by halpipe.
#include <ctime>
#include <memory>
#include <string>
#include <vector>

#include "bindings.hpp"
#include "dispatch.h"
#include "rclcpp/rclcpp.hpp"
#include "rclcpp_components/component_manager.hpp"
#include "std_srvs/srv/trigger.hpp"
#include "table_executor.hpp"

namespace {

table::Executor * executor = nullptr;

int run(const dispatch_job * job, int64_t) {return executor->run(job->program) ? DISPATCH_RAN : DISPATCH_NO_DATA;}

class Container : public rclcpp_components::ComponentManager {
public:
  explicit Container(std::shared_ptr<table::Executor> tables)
  : ComponentManager(tables, "table_container"), tables_(tables) {
    priority_ = static_cast<int>(declare_parameter<int64_t>("priority", PRIORITY));
    record_ = declare_parameter<std::string>("record", "");
    events_ = declare_parameter<int64_t>("events", 4096);
    for (int i = 0; i < plan.n_modes; i++) {
      const auto ask = [i](
        const std::shared_ptr<std_srvs::srv::Trigger::Request>, std::shared_ptr<std_srvs::srv::Trigger::Response> answer) {
        dispatch_request(i);
        answer->success = true;
      };
      modes_.push_back(create_service<std_srvs::srv::Trigger>("~/mode/" + table::mode_names[i], ask));
    }
  }

  ~Container() override {
    if (!is_started_) {return;}
    dispatch_stop();
    dispatch_wait(5);
    if (dispatch_finish()) {RCLCPP_ERROR(get_logger(), "%s cannot be written", record_.c_str());}
  }

protected:
  // Parameter services share the group of the node's callbacks, so nobody could serve them beside the table.
  rclcpp::NodeOptions create_node_options(const std::shared_ptr<LoadNode::Request> request) override {
    return ComponentManager::create_node_options(request)
           .start_parameter_services(false).start_parameter_event_publisher(false);
  }

  void add_node_to_executor(uint64_t id) override {
    if (is_started_) {
      RCLCPP_ERROR(get_logger(), "the tables are played already; this node is not run");
      return;
    }
    tables_->adopt(node_wrappers_.at(id).get_node_base_interface());
    if (tables_->has_nodes(table::rows, table::n_rows)) {start();}
  }

  void remove_node_from_executor(uint64_t) override {
    RCLCPP_ERROR(get_logger(), "a node of the tables is not unloaded while they are played");
  }

private:
  void start() {
    const std::vector<std::string> wrong = tables_->bind(table::rows, table::n_rows);
    for (const std::string & text : wrong) {RCLCPP_ERROR(get_logger(), "%s", text.c_str());}
    if (!wrong.empty()) {
      RCLCPP_ERROR(get_logger(), "the tables are not played: schedule all callbacks, or take the others out of the nodes");
      return;
    }
    for (int i = 0; i < plan.n_workers; i++) {cpus_.push_back(plan.workers[i].cpu);}
    dispatch_options options{};
    options.priority = priority_;
    options.clock = CLOCK_MONOTONIC;
    options.refuge = -1;
    options.lead = 300000;
    options.capacity = static_cast<size_t>(events_);
    options.cpus = cpus_.data();
    dispatch_hook(run);
    is_started_ = (record_.empty() || dispatch_record(record_.c_str(), 1 << 30) == 0) && dispatch_start(&options) == 0;
    if (!is_started_) {
      RCLCPP_ERROR(get_logger(), "%s: give this process CAP_SYS_NICE, or ulimit -r 98; priority:=0 does without",
                   dispatch_reason);
    }
  }

  std::shared_ptr<table::Executor> tables_;
  std::vector<rclcpp::ServiceBase::SharedPtr> modes_;
  std::vector<int> cpus_;
  int priority_ = 0;
  int64_t events_ = 0;
  std::string record_;
  bool is_started_ = false;
};

}  // namespace

int main(int argc, char ** argv) {
  rclcpp::init(argc, argv);
  auto tables = std::make_shared<table::Executor>(table::takes_newest);
  executor = tables.get();
  {
    auto container = std::make_shared<Container>(tables);
    rclcpp::executors::SingleThreadedExecutor background;   // loading, modes: at normal priority
    background.add_node(container);
    background.spin();
  }
  rclcpp::shutdown();
  return 0;
}
