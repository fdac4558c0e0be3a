// Executor of the background lane, and the callbacks that the tables run. Written by halpipe.
//
// All nodes belong to this executor as to any other one: it serves services, parameters, lifecycle, actions, timers and
// subscriptions, whenever they were created. It leaves alone what a row of the tables runs, which the threads of the
// dispatcher do at their instants. The API of rclcpp used here is shared by Humble, Jazzy and Rolling.
#pragma once
#include <pthread.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <ctime>
#include <deque>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "rcl/timer.h"
#include "rclcpp/rclcpp.hpp"
#include "rclcpp/version.h"

namespace table {

struct Row {              // the callback of a program of the tables
  const char *task, *node, *kind, *subject;   // kind: timer or subscription; subject: the topic
  int64_t period;         // ns, of a timer
  size_t order;           // among equal ones of the node
  int64_t wait;           // ns for which a job waits for its message
  int missing;            // the mode to go to without one, -1: none
};

enum class Result {failed = -1, no_data, ran};

// The thread that holds it has the priority of the one that waits for it.
class Mutex {
public:
  Mutex() {
    pthread_mutexattr_t attributes;
    pthread_mutexattr_init(&attributes);
    pthread_mutexattr_setprotocol(&attributes, PTHREAD_PRIO_INHERIT);
    pthread_mutexattr_settype(&attributes, PTHREAD_MUTEX_RECURSIVE);
    pthread_mutex_init(&mutex_, &attributes);
    pthread_mutexattr_destroy(&attributes);
  }
  ~Mutex() {pthread_mutex_destroy(&mutex_);}
  Mutex(const Mutex &) = delete;
  Mutex & operator=(const Mutex &) = delete;
  void lock() {pthread_mutex_lock(&mutex_);}
  void unlock() {pthread_mutex_unlock(&mutex_);}

private:
  pthread_mutex_t mutex_;
};

// A timer or subscription. It does not keep them alive: a node that goes, or a lifecycle node that is cleaned up, takes
// its callbacks with it.
struct Callback {
  std::string node, kind, subject;
  int64_t period = 0;
  std::weak_ptr<rclcpp::TimerBase> timer;
  std::weak_ptr<rclcpp::SubscriptionBase> subscription;
  std::weak_ptr<rclcpp::CallbackGroup> group;
  std::shared_ptr<Mutex> exclusion;             // of a mutually exclusive group
  std::deque<std::shared_ptr<void>> taken;      // messages within the process that the wait of the background lane took
  bool is_claimed = false, has_run = false;     // claimed: a row runs it
  bool is_in_step = false;                      // the last job had a message

  bool is_there() const {return !timer.expired() || !subscription.expired();}
};

class Executor;

// A thread of the background lane: it serves what is added to it, but for what a row runs.
class Lane : public rclcpp::Executor {
public:
  explicit Lane(table::Executor * tables) : tables_(tables) {}

  // Until the context is shut down, or it is cancelled.
  void spin() override {
    if (spinning.exchange(true)) {throw std::runtime_error("spin() is running");}
    while (rclcpp::ok(context_) && spinning.load()) {
      wait_for_work(std::chrono::milliseconds(500));
      bool has_claimed = false, has_other = false;
      while (spinning.load() && step(has_claimed, has_other)) {}
      // Messages that wait for their rows end each wait at once, so that the lane would spin until they are taken.
      if (has_claimed && !has_other) {std::this_thread::sleep_for(std::chrono::milliseconds(5));}
    }
#if RCLCPP_VERSION_GTE(28, 0, 0)
    wait_result_.reset();
#endif
    spinning.store(false);
  }

private:
  bool step(bool & has_claimed, bool & has_other);

  table::Executor * const tables_;
};

class Executor : public Lane {
public:
  using Callbacks = std::vector<std::shared_ptr<Callback>>;

  Executor(const Row * rows, size_t count, bool takes_newest)
  : Lane(this), rows_(rows), count_(count), takes_newest_(takes_newest), bound_(count) {}

  void adopt(const rclcpp::node_interfaces::NodeBaseInterface::SharedPtr & node) {
    std::lock_guard<Mutex> guard(taking_);
    nodes_.push_back(node);
    bind();
  }

  // The tasks whose callbacks are in a group.
  std::set<std::string> tasks_of(const rclcpp::CallbackGroup::SharedPtr & group) const {
    std::set<std::string> found;
    for (size_t i = 0; i < count_; i++) {
      const auto callback = std::atomic_load(&bound_[i]);
      if (callback && callback->group.lock() == group) {found.insert(rows_[i].task);}
    }
    return found;
  }

  // Find the callback of each row. Lifecycle nodes create theirs when they are configured, so this is done again and
  // again. Return why rows cannot be told apart; an ambiguous row is not bound.
  std::vector<std::string> bind() {
    std::lock_guard<Mutex> guard(taking_);
    std::map<const void *, std::shared_ptr<Callback>> known;
    std::map<std::string, Callbacks> by_node;
    for (const auto & weak : nodes_) {
      const auto node = weak.lock();
      if (!node || !has_rows(node->get_fully_qualified_name())) {continue;}
      collect(node, known, by_node[node->get_fully_qualified_name()]);
    }
    known_ = std::move(known);
    for (auto one = foreign_.begin(); one != foreign_.end();) {
      one = one->second.expired() ? foreign_.erase(one) : std::next(one);
    }
    std::vector<std::string> ambiguous;
    for (size_t i = 0; i < count_; i++) {
      std::shared_ptr<Callback> found;
      const Callbacks equal = equal_to(rows_[i], by_node[rows_[i].node]);
      std::set<const void *> groups;
      for (const auto & one : equal) {groups.insert(one->group.lock().get());}
      if (groups.size() > 1) {
        ambiguous.push_back(
          "task " + std::string(rows_[i].task) + ": " + std::to_string(equal.size()) + " equal callbacks of node " +
          rows_[i].node + " (" + rows_[i].kind + ' ' + rows_[i].subject + ") are in different callback groups, whose order "
          "is not that of construction: put them into one group, or give timers periods that differ by more than 0.1 %");
      } else if (rows_[i].order < equal.size()) {
        found = equal[rows_[i].order];
      }
      for (const auto & one : equal) {one->is_claimed |= groups.size() > 1 || one == found;}
      std::atomic_store(&bound_[i], found);
    }
    return ambiguous;
  }

  std::vector<std::string> unbound() const {
    std::vector<std::string> found;
    for (size_t i = 0; i < count_; i++) {
      const auto callback = std::atomic_load(&bound_[i]);
      if (callback && callback->is_there()) {continue;}
      found.push_back(std::string(rows_[i].task) + " (" + rows_[i].kind + ' ' + rows_[i].subject + " of " + rows_[i].node + ')');
    }
    return found;
  }

  // Callbacks of nodes with rows that run in the background lane.
  std::vector<std::string> others() {
    std::lock_guard<Mutex> guard(taking_);
    std::vector<std::string> found;
    std::set<const Callback *> seen;
    for (const auto & one : known_) {
      if (!one.second->is_claimed && seen.insert(one.second.get()).second) {
        found.push_back(one.second->kind + ' ' + one.second->subject + " of " + one.second->node);
      }
    }
    return found;
  }

  bool has_rows(const std::string & node) const {
    for (size_t i = 0; i < count_; i++) {
      if (node == rows_[i].node) {return true;}
    }
    return false;
  }

  // Run the callback of a row, due or not: the table decides when. `planned` is the instant of the job.
  Result run(size_t row, int64_t planned = 0) {
    const auto callback = std::atomic_load(&bound_[row]);
    if (!callback) {return Result::no_data;}
    try {
      if (const auto timer = callback->timer.lock()) {return run_timer(*callback, timer);}
      if (const auto subscription = callback->subscription.lock()) {return run_subscription(rows_[row], *callback, subscription, planned);}
    } catch (const std::exception & failure) {
      return failed(row, failure.what());
    } catch (...) {
      return failed(row, "an exception without a description");
    }
    return Result::no_data;
  }

private:
  friend class Lane;

  class Exclusion {   // of a callback group, if it has one
  public:
    explicit Exclusion(std::shared_ptr<Mutex> mutex) : mutex_(std::move(mutex)) {if (mutex_) {mutex_->lock();}}
    ~Exclusion() {if (mutex_) {mutex_->unlock();}}
    Exclusion(const Exclusion &) = delete;
    Exclusion & operator=(const Exclusion &) = delete;

  private:
    std::shared_ptr<Mutex> mutex_;
  };

  Result failed(size_t row, const char * what) {
    if (!rclcpp::ok(context_)) {return Result::no_data;}   // the middleware refuses all calls by now
    RCLCPP_ERROR(rclcpp::get_logger("tables"), "task %s: %s", rows_[row].task, what);
    return Result::failed;
  }

  bool claims(const rclcpp::AnyExecutable & ready) {
    const std::shared_ptr<void> entity = ready.timer ? std::shared_ptr<void>(ready.timer) :
      ready.subscription ? std::shared_ptr<void>(ready.subscription) : std::shared_ptr<void>(ready.waitable);
    const auto foreign = foreign_.find(entity.get());
    if (!entity || (foreign != foreign_.end() && !foreign->second.expired())) {return false;}
    auto found = known_.find(entity.get());
    if (found == known_.end() || !found->second->is_there()) {
      bind();
      found = known_.find(entity.get());
    }
    if (found == known_.end()) {foreign_[entity.get()] = entity;}
    if (found == known_.end() || !found->second->is_claimed) {return false;}
    if (ready.waitable && ready.data) {keep(*found->second, ready.data);}
    return true;
  }

  void keep(Callback & callback, const std::shared_ptr<void> & message) {
    const auto subscription = callback.subscription.lock();
    const size_t room = takes_newest_ || !subscription ? 1 : std::max<size_t>(1, subscription->get_actual_qos().depth());
    while (callback.taken.size() >= room) {callback.taken.pop_front();}
    callback.taken.push_back(message);
  }

  std::shared_ptr<Mutex> exclusion_of(const rclcpp::CallbackGroup::SharedPtr & group) {
    if (!group || group->type() != rclcpp::CallbackGroupType::MutuallyExclusive) {return nullptr;}
    for (auto one = exclusions_.begin(); one != exclusions_.end();) {
      const auto known = one->first.lock();
      if (known == group) {return one->second;}
      one = known ? std::next(one) : exclusions_.erase(one);
    }
    exclusions_.emplace_back(group, std::make_shared<Mutex>());
    return exclusions_.back().second;
  }

  // Find the callbacks of a node, but those of groups that the node spins itself, such as those of tf2's listener.
  void collect(
    const rclcpp::node_interfaces::NodeBaseInterface::SharedPtr & node,
    std::map<const void *, std::shared_ptr<Callback>> & known, Callbacks & found)
  {
    node->for_each_callback_group([&](rclcpp::CallbackGroup::SharedPtr group) {
      if (!group->automatically_add_to_executor_with_node()) {return;}
      // The threads of the dispatcher read a callback, so nothing of it changes once it is known.
      const auto entry = [&](const void * entity, const std::string & kind) {
        const auto former = known_.find(entity);
        const bool is_known = former != known_.end() && former->second->is_there();
        auto callback = is_known ? former->second : std::make_shared<Callback>();
        if (!is_known) {
          callback->node = node->get_fully_qualified_name();
          callback->kind = kind;
          callback->group = group;
          callback->exclusion = exclusion_of(group);
        }
        callback->is_claimed = false;
        known[entity] = callback;
        found.push_back(callback);
        return is_known ? nullptr : callback;
      };
      group->collect_all_ptrs(
        [&](const rclcpp::SubscriptionBase::SharedPtr & one) {
          if (const auto callback = entry(one.get(), "subscription")) {
            callback->subject = one->get_topic_name();
            callback->subscription = one;
          }
          if (const auto intra = one->get_intra_process_waitable()) {known[intra.get()] = known[one.get()];}
        },
        [](const rclcpp::ServiceBase::SharedPtr &) {}, [](const rclcpp::ClientBase::SharedPtr &) {},
        [&](const rclcpp::TimerBase::SharedPtr & one) {
          if (const auto callback = entry(one.get(), "timer")) {
            callback->timer = one;
            if (rcl_timer_get_period(one->get_timer_handle().get(), &callback->period) != RCL_RET_OK) {callback->period = 0;}
          }
        },
        [](const rclcpp::Waitable::SharedPtr &) {});
    });
  }

  // The callbacks of a node that the row may mean, in the order of construction where they are of one group. A timer is
  // one of the nearest period that a row has, since graphs and traces state periods that were measured.
  Callbacks equal_to(const Row & row, const Callbacks & callbacks) const {
    Callbacks found;
    for (const auto & one : callbacks) {
      const bool is_timer = one->kind == "timer";
      if (one->kind == row.kind && (is_timer ? nearest(row.node, one->period) == row.period : one->subject == row.subject)) {
        found.push_back(one);
      }
    }
    return found;
  }

  int64_t nearest(const std::string & node, int64_t period) const {
    int64_t best = -1, least = 0;
    for (size_t i = 0; i < count_; i++) {
      if (node != rows_[i].node || rows_[i].kind != std::string("timer")) {continue;}
      const int64_t distance = period > rows_[i].period ? period - rows_[i].period : rows_[i].period - period;
      if (distance <= rows_[i].period / 1000 && (best < 0 || distance < least)) {
        best = rows_[i].period;
        least = distance;
      }
    }
    return best;
  }

  Result run_timer(const Callback & callback, const rclcpp::TimerBase::SharedPtr & timer) {
    Exclusion exclusion(callback.exclusion);
#if RCLCPP_VERSION_GTE(28, 0, 0)
    auto data = timer->call();   // moves its next time on; nullptr: cancelled
    if (!data) {return Result::no_data;}
    execute_timer(timer, data);
#else
    if (!timer->call()) {return Result::no_data;}
    execute_timer(timer);
#endif
    return Result::ran;
  }

  using Handler = std::function<void()>;   // of a message that was taken

  // Run the callback with a message that is there at the instant of the job, or comes within the wait of its row. At the
  // start, and after a job without one, what is there may be the message of the job before; one that comes is preferred,
  // so that a source slightly behind the table is not a table behind for good.
  Result run_subscription(
    const Row & row, Callback & callback, const rclcpp::SubscriptionBase::SharedPtr & subscription, int64_t planned)
  {
    // What waited before the tables began would stay in the queue for good, since each job takes one message.
    const bool drains = takes_newest_ || !callback.has_run;
    callback.has_run = true;
    Handler found = next(callback, subscription, drains);
    while ((!found || !callback.is_in_step) && now() < planned + row.wait) {
      std::this_thread::sleep_for(std::chrono::microseconds(50));
      if (Handler later = next(callback, subscription, drains)) {
        found = std::move(later);
        break;
      }
    }
    callback.is_in_step = static_cast<bool>(found);
    if (!found) {return Result::no_data;}
    Exclusion exclusion(callback.exclusion);
    found();
    return Result::ran;
  }

  static int64_t now() {
    timespec t{};
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
  }

  Handler next(Callback & callback, const rclcpp::SubscriptionBase::SharedPtr & subscription, bool drains) {
    if (const auto intra = subscription->get_intra_process_waitable()) {
      if (const auto data = within(callback, *intra, drains)) {return [intra, data] {execute(*intra, data);};}
    }
    return take(subscription, drains);
  }

  std::shared_ptr<void> within(Callback & callback, rclcpp::Waitable & intra, bool drains) {
    std::lock_guard<Mutex> guard(taking_);
    std::shared_ptr<void> found;
    while (!callback.taken.empty() && (drains || !found)) {
      found = callback.taken.front();
      callback.taken.pop_front();
    }
    while (drains || !found) {
      auto later = intra.take_data();   // nullptr: nothing there
      if (!later) {break;}
      found = later;
    }
    return found;
  }

  static void execute(rclcpp::Waitable & intra, std::shared_ptr<void> data) {
#if RCLCPP_VERSION_GTE(28, 0, 0)
    intra.execute(std::as_const(data));
#else
    intra.execute(data);
#endif
  }

  // The public way to take, because execute_subscription does not say whether there was a message. rclcpp gives the oldest.
  static Handler take(const rclcpp::SubscriptionBase::SharedPtr & subscription, bool drains) {
#if RCLCPP_VERSION_GTE(21, 0, 0)
    if (subscription->get_delivered_message_kind() == rclcpp::DeliveredMessageKind::DYNAMIC_MESSAGE) {
      return [subscription] {execute_subscription(subscription);};
    }
#endif
    if (subscription->is_serialized()) {
      return take_with(
        drains, [=] {return subscription->create_serialized_message();},
        [=](auto & message, auto & info) {return subscription->take_serialized(*message, info);},
        [=](auto & message) {subscription->return_serialized_message(message);},
        [=](auto & message, auto & info) {subscription->handle_serialized_message(message, info);});
    }
    return take_with(
      drains, [=] {return subscription->create_message();},
      [=](auto & message, auto & info) {return subscription->take_type_erased(message.get(), info);},
      [=](auto & message) {subscription->return_message(message);},
      [=](auto & message, auto & info) {subscription->handle_message(message, info);});
  }

  template<typename Create, typename Take, typename Return, typename Handle>
  static Handler take_with(bool drains, Create create, Take take, Return give_back, Handle handle) {
    auto message = create();
    rclcpp::MessageInfo info = plain_info();
    if (!take(message, info)) {
      give_back(message);
      return nullptr;
    }
    while (drains) {
      auto later = create();
      rclcpp::MessageInfo later_info = plain_info();
      const bool is_later = take(later, later_info);
      give_back(is_later ? message : later);
      if (!is_later) {break;}
      message = later;
      info = later_info;
    }
    return [=]() mutable {
      handle(message, info);
      give_back(message);
    };
  }

  static rclcpp::MessageInfo plain_info() {
    rclcpp::MessageInfo info;
    info.get_rmw_message_info().from_intra_process = false;
    return info;
  }

  const Row * const rows_;
  const size_t count_;
  const bool takes_newest_;
  std::vector<std::weak_ptr<rclcpp::node_interfaces::NodeBaseInterface>> nodes_;
  std::map<const void *, std::shared_ptr<Callback>> known_;   // by timer, subscription and its waitable
  std::map<const void *, std::weak_ptr<void>> foreign_;       // of nodes without rows
  std::vector<std::pair<std::weak_ptr<rclcpp::CallbackGroup>, std::shared_ptr<Mutex>>> exclusions_;
  std::vector<std::shared_ptr<Callback>> bound_;              // by row; read by the threads of the dispatcher
  Mutex taking_;                                              // of all but `bound_`
};

// Execute one thing that is ready unless a row runs it; return whether there was one.
inline bool Lane::step(bool & has_claimed, bool & has_other) {
  rclcpp::AnyExecutable ready;
  std::shared_ptr<Mutex> mutex;
  {
    // Getting a waitable takes its message, which is to be kept for its row before the row looks for it.
    std::lock_guard<Mutex> guard(tables_->taking_);
    if (!get_next_ready_executable(ready)) {return false;}
    const bool is_claimed = tables_->claims(ready);
    (is_claimed ? has_claimed : has_other) = true;
    if (is_claimed) {return true;}
    mutex = tables_->exclusion_of(ready.callback_group);
  }
  table::Executor::Exclusion exclusion(mutex);
  execute_any_executable(ready);
  return true;
}

}  // namespace table
