// rclcpp_components/src/component_manager.cpp: the destructor removes each node from the executor, which throws for a node
// that was never added; an unload removes the node and then destroys it; a load creates the options, then the node, which
// is then added. Parameters are those of rcl_interfaces/msg/Parameter.msg.
#pragma once
#include <map>
#include <vector>

#include "rclcpp/rclcpp.hpp"

namespace rcl_interfaces::msg {
struct ParameterValue {bool bool_value = false;};
struct Parameter {
  std::string name;
  ParameterValue value;
};
}  // namespace rcl_interfaces::msg

namespace composition_interfaces::srv {
struct LoadNode {
  struct Request {std::vector<rcl_interfaces::msg::Parameter> parameters;};
  struct Response {};
};
struct UnloadNode {
  struct Request {uint64_t unique_id;};
  struct Response {bool success = false; std::string error_message;};
};
}  // namespace composition_interfaces::srv

namespace rclcpp_components {
class NodeInstanceWrapper {
public:
  NodeInstanceWrapper() = default;
  explicit NodeInstanceWrapper(std::shared_ptr<rclcpp::Node> node) : node_(std::move(node)) {}
  rclcpp::node_interfaces::NodeBaseInterface::SharedPtr get_node_base_interface() {return node_->get_node_base_interface();}
private:
  std::shared_ptr<rclcpp::Node> node_;
};
class ComponentManager : public rclcpp::Node {
public:
  using LoadNode = composition_interfaces::srv::LoadNode;
  using UnloadNode = composition_interfaces::srv::UnloadNode;
  ComponentManager(
    std::weak_ptr<rclcpp::Executor> executor = std::weak_ptr<rclcpp::Executor>(),
    std::string node_name = "ComponentManager", const rclcpp::NodeOptions & node_options = rclcpp::NodeOptions())
  : Node(std::move(node_name), node_options), executor_(executor) {}
  virtual ~ComponentManager() {
    if (auto executor = executor_.lock()) {
      for (auto & wrapper : node_wrappers_) {executor->remove_node(wrapper.second.get_node_base_interface());}
    }
  }
  uint64_t stub_load(std::shared_ptr<rclcpp::Node> node, std::vector<rcl_interfaces::msg::Parameter> parameters = {}) {
    auto request = std::make_shared<LoadNode::Request>();
    request->parameters = std::move(parameters);
    create_node_options(request);
    const uint64_t id = next_++;
    node_wrappers_[id] = NodeInstanceWrapper(std::move(node));
    add_node_to_executor(id);
    return id;
  }
  std::shared_ptr<UnloadNode::Response> stub_unload(uint64_t id) {
    auto answer = std::make_shared<UnloadNode::Response>();
    auto request = std::make_shared<UnloadNode::Request>();
    request->unique_id = id;
    on_unload_node(nullptr, request, answer);
    return answer;
  }
protected:
  virtual rclcpp::NodeOptions create_node_options(const std::shared_ptr<LoadNode::Request>) {return {};}
  virtual void add_node_to_executor(uint64_t node_id) {
    if (auto executor = executor_.lock()) {executor->add_node(node_wrappers_[node_id].get_node_base_interface(), true);}
  }
  virtual void remove_node_from_executor(uint64_t node_id) {
    if (auto executor = executor_.lock()) {executor->remove_node(node_wrappers_[node_id].get_node_base_interface());}
  }
  virtual void on_unload_node(
    const std::shared_ptr<rmw_request_id_t>, const std::shared_ptr<UnloadNode::Request> request,
    std::shared_ptr<UnloadNode::Response> response)
  {
    remove_node_from_executor(request->unique_id);
    response->success = node_wrappers_.erase(request->unique_id) > 0;
  }
  std::weak_ptr<rclcpp::Executor> executor_;
  std::map<uint64_t, NodeInstanceWrapper> node_wrappers_;
private:
  uint64_t next_ = 1;
};
}  // namespace rclcpp_components
