// Takes and executes exactly the callback that a table names, at the instant that the dispatcher says. A thin shim over
// the API of rclcpp that Humble, Jazzy and later share; everything else is in the dispatcher. Written by halpipe.
#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "rcl/timer.h"
#include "rclcpp/rclcpp.hpp"
#include "rclcpp/version.h"

namespace table {

struct Row {              // what a program of the tables is in ROS
  const char *task, *node, *kind, *subject;   // kind: timer or subscription; subject: the topic
  int64_t period;         // ns, of a timer
  size_t order;           // among equal ones of the node
};

struct Callback {         // exactly one of timer and subscription is set; intra beside a subscription
  std::string node, kind, subject;
  int64_t period = 0;
  size_t order = 0;
  rclcpp::TimerBase::SharedPtr timer;
  rclcpp::SubscriptionBase::SharedPtr subscription;
  rclcpp::Waitable::SharedPtr intra;
};

class Executor : public rclcpp::Executor {
public:
  explicit Executor(bool takes_newest, const rclcpp::ExecutorOptions & options = rclcpp::ExecutorOptions())
  : rclcpp::Executor(options), takes_newest_(takes_newest) {}

  void spin() override {}   // the threads of the dispatcher do

  // Find the timers and subscriptions of a node that has all of them.
  void adopt(const rclcpp::node_interfaces::NodeBaseInterface::SharedPtr & node) {
    const std::string name = node->get_fully_qualified_name();
    std::map<std::string, size_t> seen;
    const auto keep = [&](Callback callback) {
      callback.node = name;
      callback.order = seen[callback.kind + ' ' + callback.subject + std::to_string(callback.period)]++;
      callbacks_.push_back(std::move(callback));
    };
    node->for_each_callback_group([&](rclcpp::CallbackGroup::SharedPtr group) {
      group->collect_all_ptrs(
        [&](const rclcpp::SubscriptionBase::SharedPtr & found) {
          Callback callback;
          callback.kind = "subscription";
          callback.subject = found->get_topic_name();
          callback.subscription = found;
          callback.intra = found->get_intra_process_waitable();
          keep(std::move(callback));
        },
        [](const rclcpp::ServiceBase::SharedPtr &) {}, [](const rclcpp::ClientBase::SharedPtr &) {},
        [&](const rclcpp::TimerBase::SharedPtr & found) {
          Callback callback;
          callback.kind = "timer";
          if (rcl_timer_get_period(found->get_timer_handle().get(), &callback.period) != RCL_RET_OK) {
            throw std::runtime_error("a timer of " + name + " does not tell its period");
          }
          callback.timer = found;
          keep(std::move(callback));
        },
        [](const rclcpp::Waitable::SharedPtr &) {});
    });
    nodes_.push_back(node);
  }

  // Find the callback of each row; return what is missing, and the callbacks that no row runs.
  std::vector<std::string> bind(const Row * rows, size_t count) {
    std::vector<std::string> wrong;
    std::vector<bool> used(callbacks_.size());
    bound_.assign(count, nullptr);
    for (size_t i = 0; i < count; i++) {
      for (size_t k = 0; k < callbacks_.size() && !bound_[i]; k++) {
        if (is(callbacks_[k], rows[i])) {
          bound_[i] = &callbacks_[k];
          used[k] = true;
        }
      }
      if (!bound_[i]) {wrong.push_back(std::string("no callback for task ") + rows[i].task + " in node " + rows[i].node);}
    }
    for (size_t k = 0; k < callbacks_.size(); k++) {
      if (!used[k] && !is_plumbing(callbacks_[k].subject)) {
        wrong.push_back("no row for a " + callbacks_[k].kind + " of " + callbacks_[k].node + ' ' + callbacks_[k].subject);
      }
    }
    return wrong;
  }

  bool has_nodes(const Row * rows, size_t count) const {
    for (size_t i = 0; i < count; i++) {
      bool found = false;
      for (const auto & node : nodes_) {found |= node->get_fully_qualified_name() == std::string(rows[i].node);}
      if (!found) {return false;}
    }
    return true;
  }

  // Run the callback of a row, due or not: the table decides when. Return whether there was something to run.
  bool run(size_t row) {
    const Callback & callback = *bound_[row];
    if (callback.timer) {
#if RCLCPP_VERSION_GTE(28, 0, 0)
      auto data = callback.timer->call();   // moves its next time on; nullptr: cancelled
      if (!data) {return false;}
      execute_timer(callback.timer, data);
#else
      if (!callback.timer->call()) {return false;}
      execute_timer(callback.timer);
#endif
      return true;
    }
    if (callback.intra) {
      auto data = callback.intra->take_data();   // nullptr: nothing there
      for (auto later = data; later && takes_newest_; later = callback.intra->take_data()) {data = later;}
      if (data) {
        callback.intra->execute(data);
        return true;
      }
    }
    return take(callback.subscription);
  }

private:
  static bool is(const Callback & callback, const Row & row) {
    if (callback.node != row.node || callback.kind != row.kind || callback.order != row.order) {return false;}
    if (!callback.timer) {return callback.subject == row.subject;}
    const int64_t difference = callback.period > row.period ? callback.period - row.period : row.period - callback.period;
    return difference <= row.period / 1000;   // traces measure periods
  }

  static bool is_plumbing(const std::string & topic) {
    return topic == "/parameter_events" || topic == "/rosout" || topic == "/clock";
  }

  // The public way to take, because execute_subscription does not say whether there was a message. rclcpp gives the oldest.
  bool take(const rclcpp::SubscriptionBase::SharedPtr & subscription) {
#if RCLCPP_VERSION_GTE(21, 0, 0)
    const bool is_plain = subscription->get_delivered_message_kind() == rclcpp::DeliveredMessageKind::ROS_MESSAGE;
#else
    const bool is_plain = !subscription->is_serialized();
#endif
    if (!is_plain || subscription->can_loan_messages()) {
      execute_subscription(subscription);
      return true;
    }
    rclcpp::MessageInfo info;
    info.get_rmw_message_info().from_intra_process = false;
    std::shared_ptr<void> message = subscription->create_message();
    const bool has_message = subscription->take_type_erased(message.get(), info);
    while (has_message && takes_newest_) {
      rclcpp::MessageInfo later_info;
      later_info.get_rmw_message_info().from_intra_process = false;
      std::shared_ptr<void> later = subscription->create_message();
      const bool is_later = subscription->take_type_erased(later.get(), later_info);
      subscription->return_message(is_later ? message : later);
      if (!is_later) {break;}
      message = later;
      info = later_info;
    }
    if (has_message) {subscription->handle_message(message, info);}
    subscription->return_message(message);
    return has_message;
  }

  const bool takes_newest_;
  std::vector<Callback> callbacks_;
  std::vector<const Callback *> bound_;
  std::vector<rclcpp::node_interfaces::NodeBaseInterface::SharedPtr> nodes_;
};

}  // namespace table
