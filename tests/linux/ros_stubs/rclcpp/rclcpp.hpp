// Declarations of rclcpp that the executor of an exported package uses, written by hand from the public API of Humble
// (16) and Jazzy (28). They declare what must be there and no more, so that what compiles here uses nothing else.
#pragma once
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "rcl/timer.h"

struct rmw_message_info_t {bool from_intra_process;};

namespace rclcpp {
class Context {public: using SharedPtr = std::shared_ptr<Context>;};
void init(int argc, char const * const * argv);
bool shutdown();
bool ok(Context::SharedPtr context = nullptr);

class MessageInfo {public: rmw_message_info_t & get_rmw_message_info();};
enum class DeliveredMessageKind {INVALID, ROS_MESSAGE, SERIALIZED_MESSAGE, DYNAMIC_MESSAGE};

class Waitable {
public:
  using SharedPtr = std::shared_ptr<Waitable>;
  virtual ~Waitable() = default;
  virtual std::shared_ptr<void> take_data() = 0;
#if STUB_RCLCPP >= 28
  virtual void execute(const std::shared_ptr<void> & data);
#endif
  virtual void execute(std::shared_ptr<void> & data);
};

class TimerBase {
public:
  using SharedPtr = std::shared_ptr<TimerBase>;
  virtual ~TimerBase() = default;
#if STUB_RCLCPP >= 28
  virtual std::shared_ptr<void> call() = 0;
  virtual void execute_callback(const std::shared_ptr<void> & data) = 0;
#else
  virtual bool call() = 0;
  virtual void execute_callback() = 0;
#endif
  std::shared_ptr<const rcl_timer_t> get_timer_handle();
};

class SubscriptionBase {
public:
  using SharedPtr = std::shared_ptr<SubscriptionBase>;
  virtual ~SubscriptionBase() = default;
  const char * get_topic_name() const;
  virtual std::shared_ptr<void> create_message() = 0;
  bool take_type_erased(void * message_out, MessageInfo & message_info_out);
  virtual void handle_message(std::shared_ptr<void> & message, const MessageInfo & message_info) = 0;
  virtual void return_message(std::shared_ptr<void> & message) = 0;
  bool is_serialized() const;
  bool can_loan_messages() const;
  Waitable::SharedPtr get_intra_process_waitable() const;
#if STUB_RCLCPP >= 28
  DeliveredMessageKind get_delivered_message_kind() const;
#endif
};

class ServiceBase {public: using SharedPtr = std::shared_ptr<ServiceBase>;};
template<typename T>
class Service : public ServiceBase {public: using SharedPtr = std::shared_ptr<Service<T>>;};
class ClientBase {public: using SharedPtr = std::shared_ptr<ClientBase>;};

class CallbackGroup {
public:
  using SharedPtr = std::shared_ptr<CallbackGroup>;
  void collect_all_ptrs(
    std::function<void(const SubscriptionBase::SharedPtr &)> sub_func,
    std::function<void(const ServiceBase::SharedPtr &)> service_func,
    std::function<void(const ClientBase::SharedPtr &)> client_func,
    std::function<void(const TimerBase::SharedPtr &)> timer_func,
    std::function<void(const Waitable::SharedPtr &)> waitable_func) const;
};

namespace node_interfaces {
class NodeBaseInterface {
public:
  using SharedPtr = std::shared_ptr<NodeBaseInterface>;
  virtual ~NodeBaseInterface() = default;
  virtual const char * get_fully_qualified_name() const = 0;
  virtual void for_each_callback_group(const std::function<void(CallbackGroup::SharedPtr)> & func) = 0;
};
}  // namespace node_interfaces

class Logger {};
class NodeOptions {
public:
  NodeOptions & start_parameter_services(bool start_parameter_services);
  NodeOptions & start_parameter_event_publisher(bool start_parameter_event_publisher);
};
class Node {
public:
  explicit Node(const std::string & name, const NodeOptions & options = NodeOptions());
  virtual ~Node() = default;
  Logger get_logger() const;
  template<typename T>
  auto declare_parameter(const std::string &, const T & default_value) -> T {return default_value;}
  template<typename T, typename C>
  typename Service<T>::SharedPtr create_service(const std::string &, C && callback) {
    callback(std::shared_ptr<typename T::Request>(), std::shared_ptr<typename T::Response>());
    return nullptr;
  }
};

struct ExecutorOptions {};
class Executor {
public:
  explicit Executor(const ExecutorOptions & options = ExecutorOptions());
  virtual ~Executor() = default;
  virtual void spin() = 0;
  virtual void add_node(std::shared_ptr<Node> node_ptr, bool notify = true);
protected:
  static void execute_subscription(SubscriptionBase::SharedPtr subscription);
#if STUB_RCLCPP >= 28
  static void execute_timer(TimerBase::SharedPtr timer, const std::shared_ptr<void> & data_ptr);
#else
  static void execute_timer(TimerBase::SharedPtr timer);
#endif
  std::atomic_bool spinning;
};
namespace executors {
class SingleThreadedExecutor : public Executor {
public:
  explicit SingleThreadedExecutor(const ExecutorOptions & options = ExecutorOptions());
  void spin() override;
};
}  // namespace executors
}  // namespace rclcpp

#define RCLCPP_ERROR(logger, ...) ((void)(logger), stub_printf(__VA_ARGS__))
void stub_printf(const char * format, ...) __attribute__((format(printf, 1, 2)));
