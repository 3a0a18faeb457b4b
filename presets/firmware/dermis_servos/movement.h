/* Movement: from counts to pulses, how far a pulse may be from the one before, and the way to the safe pose. */
#pragma once
#include "pulses.h"

#ifdef DERMIS_RELAY_PIN
static_assert(chip_relay_pin(DERMIS_RELAY_PIN), "DERMIS_RELAY_PIN: this pin cannot be the relay's, README.md says which can");
#endif

static const uint8_t MOST_STEPS = 5; /* ms of a way to safety that a stalled loop may make up for */
static const uint8_t ARRIVING = 100; /* ms that a relay stays on for at the safe pose: servos lag behind their pulses */

static bool pose_known = false;
static uint16_t target[CHANNELS];
static uint32_t stepped = 0;

static bool homing = false, leaps = false; /* on the way to safety: a straight line from where it began, or at once */
static uint16_t way_start[CHANNELS], way_slew[CHANNELS], way_ms = 0, way_gone = 0;
static uint32_t way_pace[CHANNELS]; /* counts a millisecond, times 65536 */
static uint8_t arrived = 0; /* ms */

static const uint32_t SPAN = LONGEST - SHORTEST; /* ticks */
static_assert(SPAN <= 65535, "CHIP_TICKS_A_US: so many ticks a pulse do not fit into 32 bits below");

static ChipTicks ticks_of(uint16_t count) {
  uint32_t rounded = (uint32_t)count * SPAN + 32767u;
  return (ChipTicks)(SHORTEST + ((rounded + (rounded >> 16) + 1) >> 16)); /* / 65535, exactly, without a division */
}

static void move_to(uint8_t channel, uint16_t count) { set_pulse(channel, ticks_of(count), count); }

static uint16_t apart(uint16_t a, uint16_t b) { return a > b ? a - b : b - a; }

/* Move a channel towards a count, no further from its last pulse than `most_a_ms` allows until the next one. However late
   and however often this is called, no pulse is too far from the one before. */
static void approach(uint8_t channel, uint16_t count, uint16_t most_a_ms) {
  uint16_t from = last_pulse(channel);
  uint32_t most = (uint32_t)most_a_ms * ROUND_MS;
  if (apart(count, from) > most) count = count > from ? from + (uint16_t)most : from - (uint16_t)most;
  if (count != counts[channel]) move_to(channel, count);
}

static void power(bool on) {
#ifdef DERMIS_RELAY_PIN
  chip_relay(DERMIS_RELAY_PIN, on);
#else
  (void)on;
#endif
}

static void begin_power() {
#ifdef DERMIS_RELAY_PIN
  chip_relay_begin(DERMIS_RELAY_PIN, false);
#endif
  power(false);
}

/* No pulses, no supply: from now on a hand may have moved the servos, so nobody knows where they are, and no way that
   was begun before leads anywhere. */
static void let_go() {
  pulsing = pose_known = homing = false;
  power(false);
}

/* Begin the way to the safe state. It keeps these counts and this speed to its end: another sender may configure the board
   meanwhile. */
static void begin_way(const uint16_t *to, const uint16_t *most_a_ms, bool at_once) {
  homing = true;
  leaps = at_once;
  way_ms = 1;
  way_gone = arrived = 0;
  for (uint8_t c = 0; c < CHANNELS; c++) {
    way_start[c] = counts[c];
    way_slew[c] = most_a_ms[c];
    target[c] = to[c];
    uint16_t needs = (uint16_t)(((uint32_t)apart(counts[c], to[c]) + most_a_ms[c] - 1) / most_a_ms[c]);
    if (needs > way_ms) way_ms = needs;
  }
  for (uint8_t c = 0; c < CHANNELS; c++) way_pace[c] = ((uint32_t)apart(counts[c], target[c]) << 16) / way_ms;
}

/* All channels begin and arrive together: a platform whose channels come home one by one tilts. Whatever other senders
   say meanwhile, only ARM takes over. */
static void go_home(uint8_t steps) {
  bool there = true;
  way_gone = way_ms - way_gone > steps ? way_gone + steps : way_ms;
  for (uint8_t c = 0; c < CHANNELS; c++) {
    uint16_t gone = (uint16_t)(way_pace[c] * way_gone >> 16);
    uint16_t at = target[c] > way_start[c] ? way_start[c] + gone : way_start[c] - gone;
    if (leaps) move_to(c, target[c]);
    else approach(c, way_gone == way_ms ? target[c] : at, way_slew[c]);
    if (last_pulse(c) != target[c]) there = false;
  }
  if (!there) return;
#ifdef DERMIS_RELAY_PIN
  arrived += steps;
  if (arrived >= ARRIVING) let_go();
#else
  homing = false;
#endif
}

/* Return the milliseconds that have passed since the last call; what a stall has saved up is not spent. */
static uint8_t passed() {
  uint32_t now = chip_us();
  uint8_t steps = 0;
  for (; now - stepped >= 1000 && steps < MOST_STEPS; steps++) stepped += 1000;
  if (now - stepped >= 1000) stepped = now;
  return steps;
}
