/* The chip's own watchdog: it resets the board where the loop or the pulses' interrupt has stood still for too long.
   A reset ends the pulses at once. It cannot ramp, so it is the last resort behind the protocol's watchdog. */
#pragma once
#include "pulses.h"

static inline void begin_watchdog() { chip_watchdog_begin(); }

/* Call it in each loop. A loop counts as alive only where a slot of the pulses has passed as well. */
static inline void alive() {
  static uint8_t seen = 0;
  if (slots == seen) return;
  seen = slots;
  chip_watchdog_feed();
}
