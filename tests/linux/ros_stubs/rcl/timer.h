#pragma once
#include <cstdint>
using rcl_ret_t = int;
constexpr rcl_ret_t RCL_RET_OK = 0;
struct rcl_timer_t {};
rcl_ret_t rcl_timer_get_period(const rcl_timer_t * timer, int64_t * period);
