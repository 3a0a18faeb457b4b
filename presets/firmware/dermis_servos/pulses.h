/* Pulses for servos: from the chip's own timer, or from PCA9685 boards. Either header provides
     CHANNELS, ROUND_HZ, ROUND_MS     servos, and how often each gets a new value
     SHORTEST_US, LONGEST_US          of a pulse; SHORTEST, LONGEST: the same in ticks
     counts, pulsed, pulsing          what is wanted, what went out last, and whether pulses go out at all
     pulses_ready                     whether they can
     slots                            counted up while pulses are alive
     set_pulse, last_pulse, begin_pulses, serve_pulses */
#pragma once
#ifdef DERMIS_PCA9685
#include "pulses_pca9685.h"
#else
#include "pulses_timer.h"
#endif
