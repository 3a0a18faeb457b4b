/* The chip's own watchdog: it resets the board where the loop or the pulses' interrupt has stood still for 250 ms.
   A reset ends the pulses at once. It cannot ramp, so it is the last resort behind the protocol's watchdog. */
#pragma once
#include "pulses.h"
#include <avr/wdt.h>

/* After such a reset the watchdog goes on, at 16 ms: off with it before anything else takes time. A bootloader that
   comes first has to do the same; README.md says which does not. */
void stop_watchdog(void) __attribute__((naked, used, section(".init3")));
void stop_watchdog(void) {
  MCUSR = 0;
  wdt_disable();
}

static void begin_watchdog() { wdt_enable(WDTO_250MS); }

/* Call it in each loop: it counts as alive only where a slot of the pulses has passed as well. */
static void alive() {
  static uint8_t seen = 0;
  if (slots == seen) return;
  seen = slots;
  wdt_reset();
}
