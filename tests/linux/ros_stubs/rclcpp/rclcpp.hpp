// Stand-ins for rclcpp that behave as the sources of Humble (16), Jazzy (28) and Rolling (29) do, as far as the container
// of an exported package can notice; written by hand, each with the file of ros2/rclcpp that it imitates. There is no
// middleware: messages are integers that a test puts into queues.
#pragma once
#include <atomic>
#include <chrono>
#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "rcl/timer.h"

struct rmw_message_info_t {bool from_intra_process;};
struct rmw_request_id_t {};

namespace stub {
inline std::atomic_bool is_up{true};
inline int64_t now() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch()).count();
}
}  // namespace stub

namespace rclcpp {
class Context {public: using SharedPtr = std::shared_ptr<Context>;};
inline void init(int, char const * const *) {stub::is_up = true;}
inline bool shutdown() {return stub::is_up.exchange(false);}
inline bool ok(Context::SharedPtr = nullptr) {return stub::is_up;}

class MessageInfo {
public:
  rmw_message_info_t & get_rmw_message_info() {return info_;}
private:
  rmw_message_info_t info_{};
};
enum class DeliveredMessageKind {INVALID, ROS_MESSAGE, SERIALIZED_MESSAGE, DYNAMIC_MESSAGE};
class SerializedMessage {};
class QoS {
public:
  explicit QoS(size_t depth) : depth_(depth) {}
  size_t depth() const {return depth_;}
private:
  size_t depth_;
};

// rclcpp/include/rclcpp/waitable.hpp: the forms of execute differ by version.
class Waitable {
public:
  using SharedPtr = std::shared_ptr<Waitable>;
  virtual ~Waitable() = default;
  virtual std::shared_ptr<void> take_data() = 0;
  virtual bool stub_is_ready() {return false;}
#if STUB_RCLCPP >= 29
  virtual void execute(const std::shared_ptr<void> & data) = 0;
#elif STUB_RCLCPP >= 28
  [[deprecated]] virtual void execute(std::shared_ptr<void> &) {}
  virtual void execute(const std::shared_ptr<void> & data) = 0;
#else
  virtual void execute(std::shared_ptr<void> & data) = 0;
#endif
};

// rclcpp/src/rclcpp/timer.cpp and rcl/src/rcl/timer.c: a call is not refused before it is due, and moves the next one.
class TimerBase {
public:
  using SharedPtr = std::shared_ptr<TimerBase>;
  TimerBase(int64_t period, std::function<void()> callback)
  : handle_(std::make_shared<rcl_timer_t>(rcl_timer_t{period})), callback_(std::move(callback)), next_(stub::now() + period) {}
  virtual ~TimerBase() = default;
#if STUB_RCLCPP >= 28
  virtual std::shared_ptr<void> call() {return move() ? std::make_shared<int>(0) : nullptr;}
  virtual void execute_callback(const std::shared_ptr<void> & data) {  // it reads the data
    if (!data) {std::abort();}
    callback_();
  }
#else
  virtual bool call() {return move();}
  virtual void execute_callback() {callback_();}
#endif
  std::shared_ptr<const rcl_timer_t> get_timer_handle() {return handle_;}
  void cancel() {is_cancelled_ = true;}
  bool is_ready() {return !is_cancelled_ && stub::now() >= next_;}
private:
  bool move() {
    if (is_cancelled_) {return false;}
    next_ = std::max<int64_t>(next_ + handle_->period, stub::now());
    return true;
  }
  std::shared_ptr<rcl_timer_t> handle_;
  std::function<void()> callback_;
  std::atomic<int64_t> next_;
  std::atomic_bool is_cancelled_{false};
};

// rclcpp/include/rclcpp/experimental/subscription_intra_process.hpp: take_data() is nullptr if the buffer is empty.
class IntraProcess : public Waitable {
public:
  explicit IntraProcess(std::function<void(int)> callback) : callback_(std::move(callback)) {}
  std::shared_ptr<void> take_data() override {
    std::lock_guard<std::mutex> guard(mutex_);
    if (buffer_.empty()) {return nullptr;}
    auto found = std::make_shared<int>(buffer_.front());
    buffer_.pop_front();
    return found;
  }
  bool stub_is_ready() override {
    std::lock_guard<std::mutex> guard(mutex_);
    return !buffer_.empty();
  }
#if STUB_RCLCPP >= 28
  void execute(const std::shared_ptr<void> & data) override {callback_(*static_cast<int *>(data.get()));}
#else
  void execute(std::shared_ptr<void> & data) override {callback_(*static_cast<int *>(data.get()));}
#endif
  void stub_put(int message, size_t depth) {
    std::lock_guard<std::mutex> guard(mutex_);
    buffer_.push_back(message);
    while (buffer_.size() > depth) {buffer_.pop_front();}
  }
private:
  std::function<void(int)> callback_;
  std::mutex mutex_;
  std::deque<int> buffer_;
};

// rclcpp/src/rclcpp/subscription_base.cpp: the oldest message is taken; a queue of the QoS depth loses its oldest.
class SubscriptionBase {
public:
  using SharedPtr = std::shared_ptr<SubscriptionBase>;
  SubscriptionBase(std::string topic, size_t depth, std::function<void(int)> callback, bool is_intra)
  : topic_(std::move(topic)), depth_(depth), callback_(std::move(callback)),
    intra_(is_intra ? std::make_shared<IntraProcess>(callback_) : nullptr) {}
  virtual ~SubscriptionBase() = default;
  const char * get_topic_name() const {return topic_.c_str();}
  QoS get_actual_qos() const {return QoS(depth_);}
  virtual std::shared_ptr<void> create_message() {return std::make_shared<int>();}
  virtual std::shared_ptr<SerializedMessage> create_serialized_message() {return std::make_shared<SerializedMessage>();}
  bool take_type_erased(void * message_out, MessageInfo &) {
    std::lock_guard<std::mutex> guard(mutex_);
    if (queue_.empty()) {return false;}
    *static_cast<int *>(message_out) = queue_.front();
    queue_.pop_front();
    return true;
  }
  bool take_serialized(SerializedMessage &, MessageInfo & info) {
    int message;
    return take_type_erased(&message, info);
  }
  virtual void handle_message(std::shared_ptr<void> & message, const MessageInfo &) {
    callback_(*static_cast<int *>(message.get()));
  }
  virtual void handle_serialized_message(const std::shared_ptr<SerializedMessage> &, const MessageInfo &) {callback_(-1);}
  virtual void return_message(std::shared_ptr<void> & message) {message.reset();}
  virtual void return_serialized_message(std::shared_ptr<SerializedMessage> & message) {message.reset();}
  bool is_serialized() const {return stub_is_serialized;}
  Waitable::SharedPtr get_intra_process_waitable() const {return intra_;}
#if STUB_RCLCPP >= 28
  DeliveredMessageKind get_delivered_message_kind() const {return DeliveredMessageKind::ROS_MESSAGE;}
#endif
  void stub_put(int message) {
    if (intra_) {return intra_->stub_put(message, depth_);}
    std::lock_guard<std::mutex> guard(mutex_);
    queue_.push_back(message);
    while (queue_.size() > depth_) {queue_.pop_front();}
  }
  bool stub_is_ready() {
    std::lock_guard<std::mutex> guard(mutex_);
    return !queue_.empty();
  }
  bool stub_is_serialized = false;
private:
  std::string topic_;
  size_t depth_;
  std::function<void(int)> callback_;
  std::shared_ptr<IntraProcess> intra_;
  std::mutex mutex_;
  std::deque<int> queue_;
};

class ServiceBase {
public:
  using SharedPtr = std::shared_ptr<ServiceBase>;
  virtual ~ServiceBase() = default;
  std::function<void()> stub_answer;
  std::atomic_int stub_requests{0};
  const char * get_service_name() const {return stub_name.c_str();}
  std::string stub_name;
};
template<typename T>
class Service : public ServiceBase {public: using SharedPtr = std::shared_ptr<Service<T>>;};
class ClientBase {
public:
  using SharedPtr = std::shared_ptr<ClientBase>;
  const char * get_service_name() const {return "";}
};

enum class CallbackGroupType {MutuallyExclusive, Reentrant};

// rclcpp/src/rclcpp/callback_group.cpp: weak pointers in order of construction.
class CallbackGroup {
public:
  using SharedPtr = std::shared_ptr<CallbackGroup>;
  explicit CallbackGroup(CallbackGroupType type, bool automatically = true) : type_(type), automatically_(automatically) {}
  void collect_all_ptrs(
    std::function<void(const SubscriptionBase::SharedPtr &)> sub_func,
    std::function<void(const ServiceBase::SharedPtr &)> service_func,
    std::function<void(const ClientBase::SharedPtr &)> client_func,
    std::function<void(const TimerBase::SharedPtr &)> timer_func,
    std::function<void(const Waitable::SharedPtr &)> waitable_func) const
  {
    std::lock_guard<std::mutex> guard(mutex_);
    each(subscriptions_, sub_func);
    each(services_, service_func);
    each(clients_, client_func);
    each(timers_, timer_func);
    each(waitables_, waitable_func);
  }
  std::atomic_bool & can_be_taken_from() {return can_be_taken_from_;}
  const CallbackGroupType & type() const {return type_;}
  bool automatically_add_to_executor_with_node() const {return automatically_;}
  std::atomic_bool & get_associated_with_executor_atomic() {return associated_;}
  template<typename T>
  void stub_add(const std::shared_ptr<T> & entity) {
    std::lock_guard<std::mutex> guard(mutex_);
    if constexpr (std::is_base_of_v<SubscriptionBase, T>) {
      subscriptions_.push_back(entity);
      if (const auto intra = entity->get_intra_process_waitable()) {waitables_.push_back(intra);}
    } else if constexpr (std::is_base_of_v<TimerBase, T>) {
      timers_.push_back(entity);
    } else if constexpr (std::is_base_of_v<ServiceBase, T>) {
      services_.push_back(entity);
    } else {
      waitables_.push_back(entity);
    }
  }
private:
  template<typename T, typename F>
  static void each(const std::vector<std::weak_ptr<T>> & all, F function) {
    for (const auto & weak : all) {
      if (const auto one = weak.lock()) {function(one);}
    }
  }
  CallbackGroupType type_;
  bool automatically_;
  std::atomic_bool can_be_taken_from_{true}, associated_{false};
  mutable std::mutex mutex_;
  std::vector<std::weak_ptr<SubscriptionBase>> subscriptions_;
  std::vector<std::weak_ptr<TimerBase>> timers_;
  std::vector<std::weak_ptr<ServiceBase>> services_;
  std::vector<std::weak_ptr<ClientBase>> clients_;
  std::vector<std::weak_ptr<Waitable>> waitables_;
};

namespace node_interfaces {
// rclcpp/src/rclcpp/node_interfaces/node_base.cpp: groups in order of creation, the default one first.
class NodeBaseInterface {
public:
  using SharedPtr = std::shared_ptr<NodeBaseInterface>;
  virtual ~NodeBaseInterface() = default;
  virtual const char * get_fully_qualified_name() const = 0;
  virtual void for_each_callback_group(const std::function<void(CallbackGroup::SharedPtr)> & func) = 0;
  virtual std::atomic_bool & get_associated_with_executor_atomic() = 0;
};
class NodeBase : public NodeBaseInterface {
public:
  explicit NodeBase(std::string name) : name_(std::move(name)), default_(make(CallbackGroupType::MutuallyExclusive, true)) {}
  const char * get_fully_qualified_name() const override {return name_.c_str();}
  void for_each_callback_group(const std::function<void(CallbackGroup::SharedPtr)> & func) override {
    std::lock_guard<std::mutex> guard(mutex_);
    for (const auto & weak : groups_) {
      if (const auto group = weak.lock()) {func(group);}
    }
  }
  std::atomic_bool & get_associated_with_executor_atomic() override {return associated_;}
  CallbackGroup::SharedPtr make(CallbackGroupType type, bool automatically) {
    auto group = std::make_shared<CallbackGroup>(type, automatically);
    std::lock_guard<std::mutex> guard(mutex_);
    groups_.push_back(group);
    return group;
  }
  CallbackGroup::SharedPtr get_default_callback_group() {return default_;}
private:
  std::mutex mutex_;
  std::vector<std::weak_ptr<CallbackGroup>> groups_;
  std::string name_;
  CallbackGroup::SharedPtr default_;
  std::atomic_bool associated_{false};
};
}  // namespace node_interfaces

class Logger {};
inline Logger get_logger(const std::string &) {return {};}
class NodeOptions {};
template<typename T>
class Publisher {
public:
  using SharedPtr = std::shared_ptr<Publisher<T>>;
  void publish(const T & message) {
    stub_last = message;
    stub_count++;
  }
  static inline T stub_last{};
  static inline int stub_count = 0;
};

namespace stub_parameters {
inline std::string record, cpus;
inline std::vector<std::string> threads;
inline int64_t priority = 0;
inline bool is_simulated = false;
}

// rclcpp/src/rclcpp/time_source.cpp: with use_sim_time the clocks of a node have the last time of /clock, which a thread of
// the TimeSource sets, and 0 before the first; without it they have the time of the system.
class Time {
public:
  explicit Time(int64_t nanoseconds) : nanoseconds_(nanoseconds) {}
  int64_t nanoseconds() const {return nanoseconds_;}
  operator long() const {return nanoseconds_;}
private:
  int64_t nanoseconds_;
};
class Clock {
public:
  using SharedPtr = std::shared_ptr<Clock>;
  Time now() const {return Time(stub_parameters::is_simulated ? stub_last.load() : stub::now());}
  static inline std::atomic<int64_t> stub_last{0};
};

class Node {
public:
  explicit Node(const std::string & name, const NodeOptions & = NodeOptions())
  : base_(std::make_shared<node_interfaces::NodeBase>("/" + name)), name_(name) {}
  virtual ~Node() = default;
  Logger get_logger() const {return {};}
  const char * get_name() const {return name_.c_str();}
  Time now() const {return clock_->now();}
  Clock::SharedPtr get_clock() {return clock_;}
  node_interfaces::NodeBaseInterface::SharedPtr get_node_base_interface() {return base_;}
  template<typename T>
  bool get_parameter(const std::string & name, T & value) const {   // use_sim_time is declared by the node's TimeSource
    if constexpr (std::is_same_v<T, bool>) {value = name == "use_sim_time" && stub_parameters::is_simulated;}
    return true;
  }
  template<typename T>
  auto declare_parameter(const std::string & name, const T & default_value) -> T {
    if constexpr (std::is_same_v<T, std::string>) {
      if (name == "record") {return stub_parameters::record;}
      if (name == "cpus") {return stub_parameters::cpus;}
    }
    if constexpr (std::is_same_v<T, std::vector<std::string>>) {return stub_parameters::threads;}
    if constexpr (std::is_same_v<T, int64_t>) {
      if (name == "priority") {return stub_parameters::priority;}
    }
    if constexpr (std::is_same_v<T, bool>) {
      if (name == "lock_memory") {return false;}
    }
    return default_value;
  }
  CallbackGroup::SharedPtr create_callback_group(CallbackGroupType type, bool automatically_add_to_executor_with_node = true) {
    return base_->make(type, automatically_add_to_executor_with_node);
  }
  template<typename D, typename C>
  TimerBase::SharedPtr create_wall_timer(D period, C callback, CallbackGroup::SharedPtr group = nullptr) {
    const auto ns = std::chrono::duration_cast<std::chrono::nanoseconds>(period).count();
    auto timer = std::make_shared<TimerBase>(ns, callback);
    (group ? group : base_->get_default_callback_group())->stub_add(timer);
    return timer;
  }
  template<typename T>
  typename Publisher<T>::SharedPtr create_publisher(const std::string &, size_t) {return std::make_shared<Publisher<T>>();}
  template<typename T, typename C>
  typename Service<T>::SharedPtr create_service(const std::string & name, C && callback) {
    auto service = std::make_shared<Service<T>>();
    service->stub_name = name;
    service->stub_answer = [callback] {
      callback(std::make_shared<typename T::Request>(), std::make_shared<typename T::Response>());
    };
    base_->get_default_callback_group()->stub_add(service);
    return service;
  }
  SubscriptionBase::SharedPtr stub_subscribe(
    const std::string & topic, size_t depth, std::function<void(int)> callback, bool is_intra = false,
    CallbackGroup::SharedPtr group = nullptr)
  {
    auto made = std::make_shared<SubscriptionBase>(topic, depth, std::move(callback), is_intra);
    (group ? group : base_->get_default_callback_group())->stub_add(made);
    return made;
  }
private:
  std::shared_ptr<node_interfaces::NodeBase> base_;
  Clock::SharedPtr clock_ = std::make_shared<Clock>();
  std::string name_;
};

// rclcpp/src/rclcpp/any_executable.cpp: one that is discarded gives its group back.
struct AnyExecutable {
  AnyExecutable() = default;
  AnyExecutable(const AnyExecutable &) = delete;
  virtual ~AnyExecutable() {if (callback_group) {callback_group->can_be_taken_from().store(true);}}
  SubscriptionBase::SharedPtr subscription;
  TimerBase::SharedPtr timer;
  ServiceBase::SharedPtr service;
  ClientBase::SharedPtr client;
  Waitable::SharedPtr waitable;
  CallbackGroup::SharedPtr callback_group;
  node_interfaces::NodeBaseInterface::SharedPtr node_base;
  std::shared_ptr<void> data;
};

struct ExecutorOptions {};

// rclcpp/src/rclcpp/executor.cpp: a node that was never added cannot be removed; groups that are not added automatically, or
// that another executor has, are left alone, and one that has an executor cannot be added again; timers come first, then subscriptions, services, waitables; the data of a waitable is taken when it is
// chosen, and a timer is called then. One that was cancelled since the wait is skipped (Humble: the memory strategy's
// get_next_timer).
class Executor {
public:
  explicit Executor(const ExecutorOptions & = ExecutorOptions()) {}
  virtual ~Executor() = default;
  virtual void spin() = 0;
  virtual void add_node(node_interfaces::NodeBaseInterface::SharedPtr node_ptr, bool = true) {
    if (node_ptr->get_associated_with_executor_atomic().exchange(true)) {
      throw std::runtime_error("has already been added to an executor.");
    }
    nodes_.push_back(node_ptr);
  }
  virtual void add_node(std::shared_ptr<Node> node_ptr, bool notify = true) {
    add_node(node_ptr->get_node_base_interface(), notify);
  }
  virtual void add_callback_group(
    CallbackGroup::SharedPtr group_ptr, node_interfaces::NodeBaseInterface::SharedPtr, bool = true)
  {
    if (group_ptr->get_associated_with_executor_atomic().exchange(true)) {
      throw std::runtime_error("Callback group has already been added to an executor.");
    }
    groups_.push_back(group_ptr);
  }
  virtual void cancel() {spinning = false;}
  virtual void remove_node(node_interfaces::NodeBaseInterface::SharedPtr node_ptr, bool = true) {
    if (!node_ptr->get_associated_with_executor_atomic().exchange(false)) {
      throw std::runtime_error("Node needs to be associated with an executor.");
    }
    nodes_.remove_if([&](const auto & weak) {return weak.lock() == node_ptr;});
  }
  virtual void remove_node(std::shared_ptr<Node> node_ptr, bool notify = true) {
    remove_node(node_ptr->get_node_base_interface(), notify);
  }
protected:
  static void execute_subscription(SubscriptionBase::SharedPtr subscription) {
    MessageInfo info;
    auto message = subscription->create_message();
    if (subscription->take_type_erased(message.get(), info)) {subscription->handle_message(message, info);}
    subscription->return_message(message);
  }
#if STUB_RCLCPP >= 28
  static void execute_timer(TimerBase::SharedPtr timer, const std::shared_ptr<void> & data_ptr) {
    timer->execute_callback(data_ptr);
  }
#else
  static void execute_timer(TimerBase::SharedPtr timer) {timer->execute_callback();}
#endif
  void execute_any_executable(AnyExecutable & any) {
    if (!spinning.load()) {return;}
#if STUB_RCLCPP >= 28
    if (any.timer) {execute_timer(any.timer, any.data);}
#else
    if (any.timer) {execute_timer(any.timer);}
#endif
    if (any.subscription) {execute_subscription(any.subscription);}
    if (any.service && any.service->stub_requests-- > 0) {any.service->stub_answer();}
#if STUB_RCLCPP >= 28
    if (any.waitable) {any.waitable->execute(std::as_const(any.data));}
#else
    if (any.waitable) {any.waitable->execute(any.data);}
#endif
    any.callback_group->can_be_taken_from().store(true);
  }
  void wait_for_work(std::chrono::nanoseconds timeout = std::chrono::nanoseconds(-1)) {
    const int64_t end = stub::now() + timeout.count();
    do {
      collect();
      if (!ready_.empty()) {return;}
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    } while (ok() && stub::now() < end);
  }
  bool get_next_ready_executable(AnyExecutable & any) {
    for (auto one = ready_.begin(); one != ready_.end();) {
      if (!one->callback_group->can_be_taken_from().load()) {
        ++one;
        continue;
      }
      std::shared_ptr<void> data;
      if (one->timer) {
        const auto called = one->timer->call();
        if (!called) {
          one = ready_.erase(one);
          continue;
        }
#if STUB_RCLCPP >= 28
        data = called;
#endif
      }
      any.subscription = one->subscription;
      any.timer = one->timer;
      any.service = one->service;
      any.waitable = one->waitable;
      any.callback_group = one->callback_group;
      any.data = one->waitable ? one->waitable->take_data() : data;
      ready_.erase(one);
      if (any.callback_group->type() == CallbackGroupType::MutuallyExclusive) {any.callback_group->can_be_taken_from() = false;}
      return true;
    }
    return false;
  }
  std::atomic_bool spinning{false};
  Context::SharedPtr context_;
#if STUB_RCLCPP >= 28
  std::optional<int> wait_result_;
#endif

private:
  struct Ready {
    SubscriptionBase::SharedPtr subscription;
    TimerBase::SharedPtr timer;
    ServiceBase::SharedPtr service;
    Waitable::SharedPtr waitable;
    CallbackGroup::SharedPtr callback_group;
  };
  void collect() {
    std::list<Ready> timers, subscriptions, services, waitables;
    const auto add = [&](const CallbackGroup::SharedPtr & group) {
      group->collect_all_ptrs(
        [&](const auto & one) {if (one->stub_is_ready()) {subscriptions.push_back({one, {}, {}, {}, group});}},
        [&](const auto & one) {if (one->stub_requests > 0) {services.push_back({{}, {}, one, {}, group});}},
        [](const auto &) {},
        [&](const auto & one) {if (one->is_ready()) {timers.push_back({{}, one, {}, {}, group});}},
        [&](const auto & one) {if (one->stub_is_ready()) {waitables.push_back({{}, {}, {}, one, group});}});
    };
    for (const auto & weak : groups_) {
      if (const auto group = weak.lock()) {add(group);}
    }
    for (const auto & weak : nodes_) {
      const auto node = weak.lock();
      if (!node) {continue;}
      node->for_each_callback_group([&](CallbackGroup::SharedPtr group) {
        const bool is_elsewhere = group->get_associated_with_executor_atomic();
        if (group->automatically_add_to_executor_with_node() && !is_elsewhere) {add(group);}
      });
    }
    ready_ = std::move(timers);
    for (auto * more : {&subscriptions, &services, &waitables}) {ready_.splice(ready_.end(), *more);}
  }
  std::list<std::weak_ptr<node_interfaces::NodeBaseInterface>> nodes_;
  std::list<std::weak_ptr<CallbackGroup>> groups_;
  std::list<Ready> ready_;
};
}  // namespace rclcpp

inline void stub_printf(const char * level, const char * format, ...) __attribute__((format(printf, 2, 3)));
inline void stub_printf(const char * level, const char * format, ...) {
  va_list arguments;
  va_start(arguments, format);
  std::fputs(level, stderr);
  std::vfprintf(stderr, format, arguments);
  std::fputc('\n', stderr);
  va_end(arguments);
}
#define RCLCPP_ERROR(logger, ...) ((void)(logger), stub_printf("ERROR ", __VA_ARGS__))
#define RCLCPP_WARN(logger, ...) ((void)(logger), stub_printf("WARN ", __VA_ARGS__))
#define RCLCPP_INFO(logger, ...) ((void)(logger), stub_printf("INFO ", __VA_ARGS__))
