#pragma once
#include <map>

#include "rclcpp/rclcpp.hpp"

namespace composition_interfaces::srv {
struct LoadNode {struct Request {}; struct Response {};};
}  // namespace composition_interfaces::srv

namespace rclcpp_components {
class NodeInstanceWrapper {
public:
  rclcpp::node_interfaces::NodeBaseInterface::SharedPtr get_node_base_interface();
};
class ComponentManager : public rclcpp::Node {
public:
  using LoadNode = composition_interfaces::srv::LoadNode;
  ComponentManager(
    std::weak_ptr<rclcpp::Executor> executor = std::weak_ptr<rclcpp::Executor>(), std::string node_name = "ComponentManager",
    const rclcpp::NodeOptions & node_options = rclcpp::NodeOptions());
  virtual ~ComponentManager();
protected:
  virtual rclcpp::NodeOptions create_node_options(const std::shared_ptr<LoadNode::Request> request);
  virtual void add_node_to_executor(uint64_t node_id);
  virtual void remove_node_from_executor(uint64_t node_id);
  std::weak_ptr<rclcpp::Executor> executor_;
  std::map<uint64_t, NodeInstanceWrapper> node_wrappers_;
};
}  // namespace rclcpp_components
