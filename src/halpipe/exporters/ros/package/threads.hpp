// Threads as a file states them: policy, priority and CPUs of callback groups and tasks. Written by halpipe.
//
// The file is that of the callback isolated executor (cie_thread_configurator): a callback group is known by its node and
// its callbacks. The launch file passes each entry on as a line: place, policy, priority, runtime, deadline, period, CPUs, ID, with
// - for what is not stated.
#pragma once
#include <sched.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "rcl/timer.h"
#include "rclcpp/rclcpp.hpp"

namespace table {

// A whole number from `low` to `high`, or -1000 where the text is none.
inline int64_t number_in(const std::string & text, int64_t low, int64_t high) {
  char * end = nullptr;
  errno = 0;
  const long long found = std::strtoll(text.c_str(), &end, 10);
  return text.empty() || *end || errno || found < low || found > high ? -1000 : found;
}

// The CPUs of a list such as 0,3; empty where it is none.
inline std::vector<int> cpus_in(const std::string & text) {
  std::vector<int> found;
  std::istringstream list(text);
  for (std::string one; std::getline(list, one, ',');) {
    const int64_t cpu = number_in(one, 0, CPU_SETSIZE - 1);
    if (cpu < 0) {return {};}
    found.push_back(static_cast<int>(cpu));
  }
  return found;
}

inline int move_to(const std::vector<int> & cpus) {
  cpu_set_t set;
  CPU_ZERO(&set);
  for (const int cpu : cpus) {CPU_SET(static_cast<size_t>(cpu), &set);}
  return cpus.empty() || !sched_setaffinity(0, sizeof set, &set) ? 0 : errno;
}

class Setting {
public:
  explicit Setting(const std::string & line) {wrong = read(line);}

  bool is_fifo() const {return attributes_.policy == SCHED_FIFO;}
  bool is_deadline() const {return attributes_.policy == deadline_policy;}
  int priority() const {return static_cast<int>(attributes_.priority);}

  // Take effect on the calling thread, whose own threads are as those of any other; return why not.
  std::string apply() const {
    if (const int error = move_to(cpus)) {return std::string("CPUs: ") + std::strerror(error);}
    if (!syscall(SYS_sched_setattr, 0, &attributes_, 0)) {return "";}
    const int error = errno;
    if (!is_deadline() || (error != EBUSY && error != EPERM)) {return std::strerror(error);}
    return error == EBUSY ?
      "the admission control of the kernel refuses the reservation (EBUSY): the sum of runtime / period passes the limit of its CPUs" :
      "SCHED_DEADLINE needs CAP_SYS_NICE, and all CPUs of its cpuset: omit background_cpus (EPERM)";
  }

  std::string place, id, wrong;   // wrong: why the entry is refused
  std::vector<int> cpus;
  bool is_plain = false, is_used = false;   // plain: states nothing, as an entry of a template does

private:
  static constexpr uint32_t deadline_policy = 6;   // glibc has no name for it before 2.41

  std::string read(const std::string & line) {
    std::istringstream fields(line);
    std::vector<std::string> field(7);
    for (std::string & one : field) {
      fields >> one;
      if (one == "-") {one.clear();}
    }
    fields >> id;
    place = field[0];
    const std::map<std::string, uint32_t> policies = {
      {"SCHED_OTHER", SCHED_OTHER}, {"SCHED_BATCH", SCHED_BATCH}, {"SCHED_IDLE", SCHED_IDLE},
      {"SCHED_FIFO", SCHED_FIFO}, {"SCHED_RR", SCHED_RR}, {"SCHED_DEADLINE", deadline_policy}};
    const auto known = policies.find(field[1]);
    if (known == policies.end()) {return "there is no policy " + field[1];}
    attributes_.policy = known->second;
    cpus = cpus_in(field[6]);
    if (!field[6].empty() && cpus.empty()) {return "affinity is a list of CPUs, not " + field[6];}
    is_plain = attributes_.policy == SCHED_OTHER && field[2] == "0" && cpus.empty();
    if (is_deadline()) {return take_reservation(field);}
    const bool is_fixed = is_fifo() || attributes_.policy == SCHED_RR;
    const int64_t priority = number_in(field[2], is_fixed ? 1 : -20, is_fixed ? 99 : 19);
    if (priority == -1000) {return "priority is from " + std::string(is_fixed ? "1 to 99" : "-20 to 19") + ", not " + field[2];}
    if (is_fixed) {attributes_.priority = static_cast<uint32_t>(priority);}
    else {attributes_.nice = static_cast<int32_t>(priority);}
    return "";
  }

  std::string take_reservation(const std::vector<std::string> & field) {
    const int64_t runtime = number_in(field[3], 1024, INT64_MAX), deadline = number_in(field[4], 1, INT64_MAX);
    const int64_t period = number_in(field[5], 1, INT64_MAX);
    if (runtime < 0 || deadline < runtime || period < deadline) {
      return "SCHED_DEADLINE has 1024 <= runtime <= deadline <= period, in ns";
    }
    if (!cpus.empty()) {return "the kernel refuses affinity of SCHED_DEADLINE: give the container a cpuset of its own";}
    attributes_.runtime = static_cast<uint64_t>(runtime);
    attributes_.deadline = static_cast<uint64_t>(deadline);
    attributes_.period = static_cast<uint64_t>(period);
    return "";
  }

  struct {          // struct sched_attr of the kernel, as sched_setattr(2) has it
    uint32_t size = 48, policy = 0;
    uint64_t flags = 1;   // SCHED_FLAG_RESET_ON_FORK, without which a thread of SCHED_DEADLINE starts no other one
    int32_t nice = 0;
    uint32_t priority = 0;
    uint64_t runtime = 0, deadline = 0, period = 0;
  } attributes_;
};

// The ID of a callback group: its node and its callbacks, each with an @ before it.
inline std::string id_of(const std::string & node, const rclcpp::CallbackGroup & group) {
  std::string id = node;
  const auto add = [&id](const char * kind, const std::string & what) {id += std::string("@") + kind + '(' + what + ')';};
  group.collect_all_ptrs(
    [&](const rclcpp::SubscriptionBase::SharedPtr & one) {add("Subscription", one->get_topic_name());},
    [&](const rclcpp::ServiceBase::SharedPtr & one) {add("Service", one->get_service_name());},
    [&](const rclcpp::ClientBase::SharedPtr & one) {add("Client", one->get_service_name());},
    [&](const rclcpp::TimerBase::SharedPtr & one) {
      int64_t period = 0;
      if (rcl_timer_get_period(one->get_timer_handle().get(), &period) == RCL_RET_OK) {add("Timer", std::to_string(period));}
    },
    [](const rclcpp::Waitable::SharedPtr &) {});
  return id;
}

}  // namespace table
