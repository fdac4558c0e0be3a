#!/bin/sh
# QoS-400 rates of transition "slow->fast", model switching, platform platform; schedule 0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef
# Rates are steps of 1/4096 transfer per cycle; 0 would switch a regulator off and never occurs.
set -e
jailhouse qos afifm2:aw_b=1,aw_r=1
jailhouse qos afifm3:ar_b=1,ar_r=123,aw_b=1,aw_r=41
jailhouse qos afifm2:ar_b=1,ar_r=103
