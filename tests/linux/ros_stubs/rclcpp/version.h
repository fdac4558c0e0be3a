// A stand-in for the generated header; -DSTUB_RCLCPP=16 is Humble, 28 is Jazzy.
#pragma once
#define RCLCPP_VERSION_GTE(major, minor, patch) (STUB_RCLCPP >= (major))
