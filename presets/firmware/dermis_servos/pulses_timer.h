/* Pulses for servos: one channel after the other, both edges timed to the tick by a timer, one round each 20 ms.

   Each pulse carries the newest value at the moment it begins: holding all channels to one moment would make the last
   one 20 ms older than it need be. */
#pragma once
#include "chip.h"
#include <stdint.h>

static_assert(DERMIS_CHANNELS >= 1, "DERMIS_CHANNELS: a board has one channel at least");
static_assert(DERMIS_CHANNELS <= CHIP_SERVOS, "DERMIS_CHANNELS: this chip has fewer servo pins");

static const uint8_t CHANNELS = DERMIS_CHANNELS;
static const uint8_t ROUND_HZ = 50;
static const uint8_t ROUND_MS = 1000 / ROUND_HZ;
static const uint16_t SHORTEST_US = 1000;
static const uint16_t LONGEST_US = 2000;
static const uint32_t SHORTEST = (uint32_t)SHORTEST_US * CHIP_TICKS_A_US; /* ticks */
static const uint32_t LONGEST = (uint32_t)LONGEST_US * CHIP_TICKS_A_US;
static const uint32_t SLOT = 1000ul * ROUND_MS * CHIP_TICKS_A_US / CHANNELS; /* 2.5 ms a channel for eight, 20 ms for all */

static_assert(SLOT <= (ChipTicks)-1, "the pulses' timer runs over within a slot: use slower ticks or a wider timer");
static_assert(LONGEST + 2 * CHIP_EARLY < SLOT, "DERMIS_CHANNELS: the longest pulses of so many do not fit into a round");

static volatile ChipTicks ticks[CHANNELS]; /* of the next pulse, 0: this channel has none ... */
static volatile uint16_t counts[CHANNELS]; /* ... and the count that it stands for */
static volatile uint16_t pulsed[CHANNELS]; /* count of the last pulse that has begun */
static volatile bool pulsing = false;
static volatile uint8_t slots = 0; /* counted, so that others can see the interrupt live */
static ChipPin pins[CHANNELS];
static uint8_t slot_channel = 0;
static bool high = false;
static ChipTicks slot_start = 0, edge = 0;

/* Whether a tick comes before another that is less than half the timer's range away. */
static inline bool before(ChipTicks a, ChipTicks b) { return (ChipTicks)(a - b) > (ChipTicks)-1 / 2; }

CHIP_ON_TIMER {
  ChipPin pin = pins[slot_channel];
  bool starts = !high && pulsing && ticks[slot_channel];
  while (before(chip_timer_now(), edge)) {}
  if (starts) {
    chip_high(pin);
    high = true;
    edge = (ChipTicks)(slot_start + ticks[slot_channel]);
    pulsed[slot_channel] = counts[slot_channel];
  } else {
    chip_low(pin);
    high = false;
    slot_channel = (uint8_t)((slot_channel + 1) % CHANNELS);
    slot_start = (ChipTicks)(slot_start + SLOT);
    edge = slot_start;
    slots = (uint8_t)(slots + 1);
  }
  chip_timer_next((ChipTicks)(edge - CHIP_EARLY));
}

static inline void set_pulse(uint8_t channel, ChipTicks value, uint16_t count) {
  ChipUndisturbed undisturbed;
  ticks[channel] = value;
  counts[channel] = count;
}

static inline uint16_t last_pulse(uint8_t channel) {
  ChipUndisturbed undisturbed;
  return pulsed[channel];
}

static const bool pulses_ready = true;
static inline void serve_pulses() {}

static inline void begin_pulses() {
  for (uint8_t c = 0; c < CHANNELS; c++) {
    pins[c] = chip_servo_pin(c);
    ticks[c] = 0;
  }
  ChipUndisturbed undisturbed;
  slot_start = edge = (ChipTicks)(chip_timer_begin(SLOT - CHIP_EARLY) + CHIP_EARLY);
}
