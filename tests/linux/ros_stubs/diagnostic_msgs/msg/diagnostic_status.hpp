#pragma once
#include "diagnostic_msgs/msg/diagnostic_array.hpp"
