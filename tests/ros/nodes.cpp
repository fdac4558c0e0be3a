// Two composable nodes for a run with a real ROS: a source that publishes its instant, a sink that measures ages.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <memory>

#include "rclcpp/rclcpp.hpp"
#include "rclcpp_components/register_node_macro.hpp"
#include "std_msgs/msg/int64.hpp"
#include "std_srvs/srv/trigger.hpp"

namespace probe {

static int64_t instant() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}

class Source : public rclcpp::Node {
public:
  explicit Source(const rclcpp::NodeOptions & options) : Node("source", options) {
    publisher_ = create_publisher<std_msgs::msg::Int64>("/x", 5);
    timer_ = create_wall_timer(std::chrono::milliseconds(20), [this] {
      std_msgs::msg::Int64 message;
      message.data = instant();
      publisher_->publish(message);
    });
  }

private:
  rclcpp::Publisher<std_msgs::msg::Int64>::SharedPtr publisher_;
  rclcpp::TimerBase::SharedPtr timer_;
};

// Beside its subscription: a service, a group that it polls itself, and half a megabyte on the stack.
class Sink : public rclcpp::Node {
public:
  explicit Sink(const rclcpp::NodeOptions & options) : Node("sink", options) {
    subscription_ = create_subscription<std_msgs::msg::Int64>("/x", 5, [this](const std_msgs::msg::Int64 & message) {
      volatile char large[512 * 1024];
      large[0] = large[sizeof large - 1] = 1;
      const int64_t age = instant() - message.data;
      if (age > oldest_) {oldest_ = age;}
    });
    service_ = create_service<std_srvs::srv::Trigger>("~/oldest", [this](
      const std::shared_ptr<std_srvs::srv::Trigger::Request>, std::shared_ptr<std_srvs::srv::Trigger::Response> answer) {
      answer->success = true;
      answer->message = std::to_string(oldest_);
    });
    polling_ = create_callback_group(rclcpp::CallbackGroupType::MutuallyExclusive, false);
    rclcpp::SubscriptionOptions own;
    own.callback_group = polling_;
    polled_ = create_subscription<std_msgs::msg::Int64>(
      "/map", 1, [](const std_msgs::msg::Int64 &) {std::abort();}, own);   // it is only taken from
  }

private:
  rclcpp::Subscription<std_msgs::msg::Int64>::SharedPtr subscription_, polled_;
  rclcpp::Service<std_srvs::srv::Trigger>::SharedPtr service_;
  rclcpp::CallbackGroup::SharedPtr polling_;
  int64_t oldest_ = 0;
};

}  // namespace probe

RCLCPP_COMPONENTS_REGISTER_NODE(probe::Source)
RCLCPP_COMPONENTS_REGISTER_NODE(probe::Sink)
