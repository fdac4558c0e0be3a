#pragma once
#include <cstdint>
using rcl_ret_t = int;
constexpr rcl_ret_t RCL_RET_OK = 0;
struct rcl_timer_t {int64_t period;};
inline rcl_ret_t rcl_timer_get_period(const rcl_timer_t * timer, int64_t * period) {
  *period = timer->period;
  return RCL_RET_OK;
}
