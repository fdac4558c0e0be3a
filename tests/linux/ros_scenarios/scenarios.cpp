// Scenarios with the container of an exported package and stand-ins for rclcpp: scenarios NAME prints what happened.
#define main container_main
#include "container.cpp"
#undef main

#include <sys/resource.h>

#include <random>

namespace {

using Group = rclcpp::CallbackGroupType;
using std::chrono::milliseconds;

struct World {
  World() {
    rclcpp::init(0, nullptr);
    tables = std::make_shared<table::Executor>(table::rows, table::n_rows, table::takes_newest);
    executor = tables.get();
    container = std::make_shared<Container>(tables);
    tables->add_node(container);
    source = std::make_shared<rclcpp::Node>("source");
    sink = std::make_shared<rclcpp::Node>("sink");
    helper = std::make_shared<rclcpp::Node>("helper");
  }

  // What the stages of a scenario do happens in the background lane, as loading a node does.
  void in_lane(int ms, std::function<void()> action) {
    auto timer = std::make_shared<rclcpp::TimerBase::SharedPtr>();
    *timer = helper->create_wall_timer(milliseconds(ms), [timer, action] {
      action();
      (*timer)->cancel();
    });
    timers.push_back(*timer);
  }

  int play(int ms) {
    container->stub_load(helper);
    const uint64_t ids[] = {container->stub_load(source), container->stub_load(sink, sink_parameters)};
    sink_id = ids[1];
    in_lane(ms, [] {rclcpp::shutdown();});
    tables->spin();
    const int status = container->finish();
    tables->remove_node(container);
    source.reset();
    sink.reset();
    container.reset();
    return status;
  }

  std::shared_ptr<table::Executor> tables;
  std::shared_ptr<Container> container;
  std::shared_ptr<rclcpp::Node> source, sink, helper;
  std::vector<rclcpp::TimerBase::SharedPtr> timers;
  std::vector<rcl_interfaces::msg::Parameter> sink_parameters;
  uint64_t sink_id = 0;
};

// A source that publishes its count at each job, and a sink that compares it with what it gets.
struct Pipe : World {
  explicit Pipe(bool is_intra = false, bool has_publisher = true) {
    subscription = sink->stub_subscribe("/a", 5, [this](int message) {
      seen++;
      wrong += message != sent;
      if (seen == 1) {first = message;}
      if (act) {act();}
    }, is_intra);
    timer = source->create_wall_timer(milliseconds(10), [this, has_publisher] {
      sent++;
      if (throw_at == sent) {throw std::runtime_error("no more wheels");}
      if (has_publisher) {subscription->stub_put(sent);}
    });
  }
  void print() {std::printf("sent %d seen %d wrong %d first %d\n", sent.load(), seen.load(), wrong.load(), first.load());}

  std::atomic_int sent{0}, seen{0}, wrong{0}, first{0};
  int throw_at = -1;
  std::function<void()> act;
  rclcpp::SubscriptionBase::SharedPtr subscription;
  rclcpp::TimerBase::SharedPtr timer;
};

int full_queue(bool is_intra) {
  Pipe pipe(is_intra);
  for (int i = 1; i <= 5; i++) {pipe.subscription->stub_put(-i);}
  const int status = pipe.play(3500);
  pipe.print();
  return status;
}

int dead() {
  Pipe pipe(false, false);
  const int status = pipe.play(3000);
  pipe.print();
  using Status = diagnostic_msgs::msg::DiagnosticStatus;
  const Status last = rclcpp::Publisher<Status>::stub_last;
  std::printf("%s level %d count %d array %d", last.name.c_str(), last.level, rclcpp::Publisher<Status>::stub_count,
              rclcpp::Publisher<diagnostic_msgs::msg::DiagnosticArray>::stub_count);
  for (const auto & one : last.values) {std::printf("; %s %s", one.key.c_str(), one.value.c_str());}
  std::printf("\n");
  return status;
}

// Everything that belongs to a node and to no row: the lane serves it, but for groups that the node spins itself.
int public_patterns() {
  Pipe pipe;
  std::atomic_int extra{0}, own{0}, late{0}, polled{0}, action{0}, overlap{0}, reentrant{0};
  auto own_group = pipe.sink->create_callback_group(Group::MutuallyExclusive, false);
  auto own_timer = pipe.sink->create_wall_timer(milliseconds(5), [&] {own++;}, own_group);
  auto polling = pipe.sink->stub_subscribe("/map", 3, [&](int) {polled++;}, false, own_group);
  auto more = pipe.sink->create_wall_timer(milliseconds(30), [&] {extra++;});
  auto free_group = pipe.source->create_callback_group(Group::Reentrant);
  auto free_timer = pipe.source->create_wall_timer(milliseconds(40), [&] {reentrant++;}, free_group);
  struct Action : rclcpp::IntraProcess {using IntraProcess::IntraProcess;};
  auto server = std::make_shared<Action>([&](int) {action++;});
  pipe.sink->get_node_base_interface()->for_each_callback_group([&](auto group) {
    if (group->automatically_add_to_executor_with_node()) {group->stub_add(std::static_pointer_cast<rclcpp::Waitable>(server));}
  });
  std::atomic_bool is_inside{false};
  auto service = pipe.sink->create_service<std_srvs::srv::Trigger>("~/reset", [&](auto, auto) {
    is_inside = true;
    std::this_thread::sleep_for(milliseconds(25));
    is_inside = false;
  });
  int answers = 0;
  service->stub_answer = [&, answer = service->stub_answer] {answer(); answers++;};
  pipe.act = [&] {overlap += is_inside;};
  rclcpp::SubscriptionBase::SharedPtr later;
  for (int i = 0; i < 4; i++) {pipe.in_lane(2200 + 200 * i, [&] {service->stub_requests++; server->stub_put(1, 9);});}
  pipe.in_lane(2300, [&] {
    polling->stub_put(1);
    later = pipe.sink->stub_subscribe("/late", 5, [&](int) {late++;});
    later->stub_put(7);
  });
  const int status = pipe.play(3600);
  pipe.print();
  std::printf("extra %d own %d polled %d late %d answers %d action %d overlap %d reentrant %d\n", int(extra > 20), own.load(),
              polled.load(), late.load(), answers, action.load(), overlap.load(), int(reentrant > 20));
  return status;
}

// One of two timers that are ready at once cancels the other, which does not run any more, claimed by a row or not.
int cancelling() {
  Pipe pipe;
  std::atomic_int first{0}, other{0}, at_cancel{-1};
  rclcpp::TimerBase::SharedPtr cancelled;
  const auto timer = pipe.helper->create_wall_timer(milliseconds(20), [&] {
    first++;
    if (first == 1) {std::this_thread::sleep_for(milliseconds(50));}   // both are ready after that
    if (first == 2) {
      at_cancel = other.load();
      cancelled->cancel();
      pipe.timer->cancel();
    }
  });
  cancelled = pipe.helper->create_wall_timer(milliseconds(20), [&] {other++;});
  const int status = pipe.play(2500);
  std::printf("first %d after %d sent %d\n", int(first > 20), other - at_cancel, pipe.sent.load());
  return status;
}

int unload() {
  Pipe pipe;
  bool before = true, playing = true;
  auto other = std::make_shared<rclcpp::Node>("other");
  const uint64_t other_id = pipe.container->stub_load(other);
  pipe.in_lane(2600, [&] {playing = pipe.container->stub_unload(pipe.sink_id)->success;});
  pipe.in_lane(2650, [&] {before = pipe.container->stub_unload(other_id)->success;});
  const int status = pipe.play(3300);
  std::printf("playing %d other %d seen %d\n", playing, before, int(pipe.seen > 50));
  return status;
}

int lifecycle() {
  Pipe pipe;
  auto keep = std::move(pipe.subscription);
  keep.reset();   // not configured yet: the node has no subscription
  pipe.subscription = std::make_shared<rclcpp::SubscriptionBase>("/a", 5, [](int) {}, false);
  pipe.in_lane(700, [&] {
    pipe.subscription = pipe.sink->stub_subscribe("/a", 5, [&](int message) {pipe.seen++; pipe.wrong += message != pipe.sent;});
  });
  const int status = pipe.play(4300);
  std::printf("seen %d wrong %d\n", int(pipe.seen > 50), pipe.wrong.load());
  return status;
}

int throwing() {
  Pipe pipe;
  pipe.throw_at = 30;
  const int status = pipe.play(20000);
  std::printf("sent %d\n", pipe.sent.load());
  return status;
}

int hanging() {
  Pipe pipe;
  pipe.act = [&] {while (pipe.seen == 30) {}};
  return pipe.play(3300);
}

// A lidar that is no task publishes 0.3 ms after each instant of the sink, which is 2 ms after that of a table of 10 ms.
int waiting() {
  table::rows[1].wait = 900000;
  Pipe pipe(false, false);
  std::atomic<int64_t> published{0};
  std::atomic_int fresh{0};
  std::thread lidar([&] {
    while (rclcpp::ok()) {
      const int64_t next = (stub::now() / 10000000 + 1) * 10000000 + 2300000;
      while (stub::now() < next) {std::this_thread::sleep_for(std::chrono::microseconds(50));}
      published = stub::now();
      pipe.subscription->stub_put(1);
    }
  });
  pipe.act = [&] {fresh += stub::now() - published < 3000000;};
  const int status = pipe.play(3500);
  lidar.join();
  std::printf("seen %d fresh %d\n", int(pipe.seen > 20), int(2 * fresh > pipe.seen));
  return status;
}

// The sink waits for a publisher that is dead, and its mode follows.
int missing() {
  table::rows[1].wait = 900000;
  table::rows[1].missing = 1;
  return Pipe(false, false).play(3000);
}

// Nodes that the tables run have the clock of the tables.
int node_simulated() {
  Pipe pipe;
  pipe.sink_parameters = {{"use_sim_time", {true}}};
  const int status = pipe.play(600);
  pipe.print();
  return status;
}

// Entries of a thread file. A node has a group of its own, whose thread says what it is; the node is unloaded while it runs.
int threads(std::vector<std::string> lines) {
  rclcpp::stub_parameters::threads = std::move(lines);
  Pipe pipe;
  auto other = std::make_shared<rclcpp::Node>("other");
  auto group = other->create_callback_group(Group::MutuallyExclusive);
  std::atomic_int nice{-1}, cpus{-1}, ticks{0}, seen{-1}, priority{-1};
  auto timer = other->create_wall_timer(milliseconds(7), [&] {
    nice = getpriority(PRIO_PROCESS, static_cast<id_t>(syscall(SYS_gettid)));
    cpu_set_t set;
    cpus = sched_getaffinity(0, sizeof set, &set) ? -1 : CPU_COUNT(&set);
    ticks++;
  }, group);
  pipe.act = [&] {
    sched_param parameter{};
    sched_getparam(0, &parameter);
    priority = parameter.sched_priority;
  };
  const uint64_t id = pipe.container->stub_load(other);
  pipe.in_lane(1500, [&] {
    pipe.container->stub_unload(id);
    seen = ticks.load();
  });
  const int status = pipe.play(2500);
  std::printf("nice %d cpus %d runs %d after %d priority %d seen %d\n", nice.load(), cpus.load(), int(ticks > 5), ticks - seen,
              priority.load(), int(pipe.seen > 10));
  return status;
}

// More reservations than the machine has time for.
int reservations() {
  auto other = std::make_shared<rclcpp::Node>("other");
  std::vector<rclcpp::CallbackGroup::SharedPtr> groups;
  std::vector<rclcpp::TimerBase::SharedPtr> timers;
  for (unsigned i = 1; i <= std::thread::hardware_concurrency() + 1; i++) {
    groups.push_back(other->create_callback_group(Group::MutuallyExclusive));
    timers.push_back(other->create_wall_timer(std::chrono::seconds(i), [] {}, groups.back()));
    rclcpp::stub_parameters::threads.push_back(
      "t.yaml:" + std::to_string(i) + " SCHED_DEADLINE - 9900000 10000000 10000000 - /other@Timer(" + std::to_string(i) + "000000000)");
  }
  Pipe pipe;
  pipe.container->stub_load(other);
  const int status = pipe.play(400);
  pipe.print();
  return status;
}

int no_cpu(const char * cpus) {
  rclcpp::stub_parameters::cpus = cpus;
  Pipe pipe;
  const int status = pipe.play(600);
  pipe.print();
  return status;
}

// A simulator that comes late, runs at some percent of the rate of the machine, pauses, and is set back.
int in_simulation(int percent) {
  rclcpp::stub_parameters::is_simulated = true;
  Pipe pipe;
  pipe.sink_parameters = {{"use_sim_time", {true}}};
  int paused = 0;
  std::thread simulator([&] {
    const auto run = [percent](int64_t from, int64_t to) {
      const int64_t begin = stub::now();
      for (int64_t time = from; rclcpp::ok() && time < to; time = from + (stub::now() - begin) * percent / 100) {
        rclcpp::Clock::stub_last = time;
        std::this_thread::sleep_for(std::chrono::microseconds(500));
      }
    };
    std::this_thread::sleep_for(milliseconds(500));
    run(8000000000 - INT64_C(8000000) * percent, 8400000000);
    std::this_thread::sleep_for(milliseconds(100));
    paused = pipe.sent;
    std::this_thread::sleep_for(milliseconds(300));
    paused -= pipe.sent;
    run(8400000000, 8600000000);
    rclcpp::Clock::stub_last = 1000000000;
  });
  const int status = pipe.play(20000);
  simulator.join();
  // Without a pause there are 30 jobs; a busy machine may run one late.
  std::printf("unpaused %d wrong %d some %d\n", int(paused < -5), pipe.wrong.load(), int(pipe.sent > 10));
  return status;
}

// Nodes with equal timers and subscriptions in random groups: each row runs its own one, or is refused.
int random_nodes() {
  std::mt19937 random(1);
  int wrong = 0, refused = 0, needless = 0, right = 0;
  for (int turn = 0; turn < 1000; turn++) {
    auto node = std::make_shared<rclcpp::Node>("pair");
    std::vector<rclcpp::CallbackGroup::SharedPtr> groups(1);
    for (size_t i = random() % 3; i > 0; i--) {groups.push_back(node->create_callback_group(Group(random() % 2)));}
    const int64_t periods[] = {20000000, 20010000, 19999000, 50000000};
    const size_t count = 1 + random() % 4;
    std::vector<table::Row> rows;
    std::vector<rclcpp::TimerBase::SharedPtr> timers;
    std::vector<rclcpp::SubscriptionBase::SharedPtr> subscriptions;
    std::vector<size_t> in;
    int ran = -1;
    for (size_t i = 0; i < count; i++) {
      if (random() % 3 == 0) {
        const char * topic = random() % 2 ? "/a" : "/b";
        size_t order = 0;
        for (const auto & row : rows) {order += row.subject == std::string(topic);}
        rows.push_back({"t", "/pair", "subscription", topic, 0, order, 0, -1});
        in.push_back(random() % groups.size());
        subscriptions.push_back(node->stub_subscribe(topic, 1, [&ran, i](int) {ran = int(i);}, random() % 2, groups[in[i]]));
        subscriptions.back()->stub_put(1);
        continue;
      }
      const int64_t period = periods[random() % 4], rounded = period == 19999000 ? 20000000 : period;
      size_t order = 0;
      for (const auto & row : rows) {order += row.period == rounded;}
      rows.push_back({"t", "/pair", "timer", "", rounded, order, 0, -1});
      in.push_back(random() % groups.size());
      timers.push_back(node->create_wall_timer(std::chrono::nanoseconds(period), [&ran, i] {ran = int(i);}, groups[in[i]]));
    }
    table::Executor tables(rows.data(), rows.size(), true);
    tables.adopt(node->get_node_base_interface());
    const bool is_refused = !tables.bind().empty();
    bool is_mixed = false;
    for (size_t i = 0; i < count; i++) {
      for (size_t k = 0; k < count; k++) {
        const bool is_equal = rows[i].period == rows[k].period && rows[i].subject == std::string(rows[k].subject);
        is_mixed |= is_equal && in[i] != in[k];
      }
      if (is_refused) {continue;}
      ran = -1;
      tables.run(i);
      (ran == int(i) ? right : wrong)++;
    }
    refused += is_refused;
    needless += is_refused && !is_mixed;
  }
  std::printf("wrong %d needless %d refused %d right %d\n", wrong, needless, int(refused > 100), int(right > 500));
  return 0;
}

}  // namespace

int main(int argc, char ** argv) {
  const std::string name = argc > 1 ? argv[1] : "";
  if (argc > 2) {rclcpp::stub_parameters::record = argv[2];}
  if (name == "full") {return full_queue(false);}
  if (name == "within") {return full_queue(true);}
  if (name == "dead") {return dead();}
  if (name == "patterns") {return public_patterns();}
  if (name == "cancelling") {return cancelling();}
  if (name == "unload") {return unload();}
  if (name == "lifecycle") {return lifecycle();}
  if (name == "throwing") {return throwing();}
  if (name == "hanging") {return hanging();}
  if (name == "waiting") {return waiting();}
  if (name == "missing") {return missing();}
  if (name == "slow_simulation") {return in_simulation(50);}
  if (name == "fast_simulation") {return in_simulation(300);}
  if (name == "node_simulated") {return node_simulated();}
  if (name == "no_cpu") {return no_cpu("u1=");}
  const std::string own = " /other@Timer(7000000)";
  if (name == "threads") {
    return threads({"t.yaml:2 SCHED_OTHER 5 - - - 0" + own, "t.yaml:7 SCHED_OTHER 0 - - - - /sink@Subscription(/a)"});
  }
  if (name == "task_threads") {
    return threads({"t.yaml:1 SCHED_FIFO 20 - - - 0 /source", "t.yaml:2 SCHED_FIFO 20 - - - - /sink@Subscription(/a)"});
  }
  if (name == "wrong_threads") {
    return threads({
      "t.yaml:1 SCHED_SOON 5 - - - -" + own, "t.yaml:2 SCHED_FIFO 0 - - - -" + own, "t.yaml:3 SCHED_OTHER 20 - - - -" + own,
      "t.yaml:4 SCHED_OTHER 1 - - - 0,x" + own, "t.yaml:5 SCHED_DEADLINE - 2000 1999 5000 -" + own,
      "t.yaml:6 SCHED_DEADLINE - 2000 3000 5000 0" + own});
  }
  if (name == "unknown_threads") {return threads({"t.yaml:1 SCHED_OTHER 1 - - - - /sink@Subscription(/b)"});}
  if (name == "reserved_task") {return threads({"t.yaml:1 SCHED_DEADLINE - 2000 3000 5000 - /sink"});}
  if (name == "apart") {
    return threads({"t.yaml:1 SCHED_FIFO 20 - - - 0 /source", "t.yaml:2 SCHED_FIFO 21 - - - 0 /sink"});
  }
  if (name == "reservations") {return reservations();}
  if (name == "two_cpus") {return no_cpu("u1=0,u1=1");}
  if (name == "no_background") {
    const char * arguments[] = {"container", "--background-cpus", "1,x"};
    return container_main(3, const_cast<char **>(arguments));
  }
  if (name == "random") {return random_nodes();}
  return 2;
}
