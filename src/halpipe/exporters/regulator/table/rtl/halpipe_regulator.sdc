# Timing of the regulators, for any board: one clock, and nothing that crosses to another one. State your own period.
set period 4.0
create_clock -name clk -period $period [get_ports clk]
# The gates pass VALID and READY on within the cycle: both sides of the interconnect share it.
set_input_delay  [expr 0.3 * $period] -clock clk [remove_from_collection [all_inputs] [get_ports {clk rst_n}]]
set_output_delay [expr 0.3 * $period] -clock clk [all_outputs]
# Reset is asserted at any time and released with the clock.
set_false_path -from [get_ports rst_n]
