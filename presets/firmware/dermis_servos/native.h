/* The native protocol, version 2 (presets/streaming.md): who may move what, when, how fast, and what ends it. */
#pragma once
#include "frames.h"
#include "last_resort.h"
#include "pulses.h"
#include <string.h>

static const uint8_t VERSION = 2;
static const uint16_t FITS = CHIP_QUEUE_BYTES / (4 + 2 * CHANNELS);
static const uint8_t QUEUE = FITS < 255 ? FITS : 255; /* 1000 bytes hold 125 commands of two channels, 50 of eight */
static_assert(QUEUE >= 1, "CHIP_QUEUE_BYTES: not one command fits");
static_assert(sizeof DERMIS_ID == 9, "DERMIS_ID has eight characters");
static_assert(chip_line_baud(DERMIS_BAUD), "DERMIS_BAUD: the chip's clock does not divide into this rate");
#ifdef DERMIS_RELAY_PIN
static_assert(chip_relay_pin(DERMIS_RELAY_PIN), "DERMIS_RELAY_PIN: this pin cannot be the relay's, README.md says which can");
#endif

/* Whatever comes in, the loop comes round to its watchdog and its limits: in 1.1 ms at the worst (emulated). */
static const uint8_t BYTES_A_LOOP = 16;
static const uint8_t NACK_EVERY = 5; /* ms */
static const uint16_t WINDOW = 1024; /* packets: what is further ahead was not lost on the way, it is old */
static const uint8_t MOST_STEPS = 5; /* ms of a way to safety that a stalled loop may make up for */
static const uint8_t LEAST_WATCHDOG = 10, MOST_WATCHDOG = 80; /* ms of silence that a sender may ask for */
static_assert(CHIP_WATCHDOG_MS > MOST_WATCHDOG, "the chip's reset must come after the way to safety has begun");
static const uint8_t ARRIVING = 100; /* ms that a relay stays on for at the safe pose: servos lag behind their pulses */

enum Kind : uint8_t {
  HELLO = 1, CONFIGURE, ARM, TO_SAFE, COMMAND, SYNC, WELCOME = 0x81, STATE = 0x85, SYNCED, NACK
};
enum State : uint8_t { IDLE, CONFIGURED, ARMED, SAFE };
enum Reach : uint8_t { AT_ONCE, RAMP, RELEASE };
enum Reason : uint8_t { DAMAGED = 1, GAP, NOT_ARMED, QUEUE_FULL, OTHER_SESSION, LATE, MALFORMED };

static State state = IDLE;
static Reach reach = RAMP;
static uint8_t session = 0; /* nobody's */
static bool pose_known = false;
static uint16_t sequence_in = 0;
static uint16_t received = 0, lost = 0, damaged = 0, late = 0, watchdogs = 0;
static uint8_t watchdog_ms = 50;
static uint16_t target[CHANNELS], safe_counts[CHANNELS], slew[CHANNELS];
static uint32_t heard = 0, stepped = 0;

static bool homing = false, leaps = false; /* on the way to safety: a straight line from where it began, or at once */
static uint16_t way_start[CHANNELS], way_ms = 0, way_gone = 0;
static uint8_t arrived = 0; /* ms */
static uint32_t way_pace[CHANNELS]; /* counts a millisecond, times 65536 */
static uint16_t way_slew[CHANNELS]; /* `slew` when the way began: another sender may configure the board meanwhile */

static uint32_t queue_when[QUEUE];
static uint16_t queue_counts[QUEUE][CHANNELS];
static uint8_t queue_first = 0, queued = 0;

/* -- movement */

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

/* No pulses, no supply: from now on a hand may have moved the servos, so nobody knows where they are, and no way that
   was begun before leads anywhere. */
static void let_go() {
  pulsing = pose_known = homing = false;
  power(false);
}

/* Begin the way to the safe state. A way that is under way goes on as it began: a second SAFE, whoever sends it, changes
   neither its speed nor its end. */
static void go_safe() {
  if (state == IDLE) return;
  queued = 0;
  state = SAFE;
  if (homing) return;
  if (reach == RELEASE) return let_go();
  homing = true;
  leaps = reach == AT_ONCE;
  way_ms = 1;
  way_gone = arrived = 0;
  for (uint8_t c = 0; c < CHANNELS; c++) {
    way_start[c] = counts[c];
    way_slew[c] = slew[c];
    target[c] = safe_counts[c];
    uint16_t needs = (uint16_t)(((uint32_t)apart(counts[c], target[c]) + slew[c] - 1) / slew[c]);
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

/* Hand over the commands whose time has come. */
static void play() {
  while (queued && (int32_t)(chip_us() - queue_when[queue_first]) >= 0) {
    memcpy(target, queue_counts[queue_first], sizeof target);
    queue_first = (uint8_t)((queue_first + 1) % QUEUE);
    queued--;
  }
}

/* -- answers */

static void say_no(uint8_t to_session, uint16_t sequence, Reason reason) {
  static uint32_t said = 0;
  uint32_t now = chip_ms();
  if (now - said < NACK_EVERY) {
    sequence_out++; /* dropped like one that finds no room */
    return;
  }
  if (!begin_answer(NACK, to_session, 3)) return;
  said = now;
  put16(sequence);
  put8(reason);
  end_answer();
}

static void say_state(uint8_t answered) {
  if (!begin_answer(STATE, session, 2)) return;
  put8(state);
  put8(answered);
  end_answer();
}

static void say_welcome() {
  if (!begin_answer(WELCOME, session, 27 + (pose_known ? 2 * CHANNELS : 0))) return;
  put8(VERSION);
  put8(CHANNELS);
  for (const char *id = DERMIS_ID; *id; id++) put8((uint8_t)*id);
  for (uint8_t i = 0; i < 8; i++) put8(0); /* any preset */
  put32(chip_us());
  put8(state);
  put8(QUEUE);
  put16(ROUND_HZ);
  put8(pose_known);
  if (pose_known) for (uint8_t c = 0; c < CHANNELS; c++) put16(counts[c]);
  end_answer();
}

static void say_synced(uint32_t token) {
  if (!begin_answer(SYNCED, session, 20)) return;
  put32(token);
  put32(chip_us());
  put8(state);
  put8(queued);
  put16(received);
  put16(lost);
  put16(damaged);
  put16(late);
  put16(watchdogs);
  end_answer();
}

/* -- packets */

static bool configure(const uint8_t *body, uint8_t size) {
  if (size != 4 + 4 * CHANNELS || body[3] != CHANNELS || body[2] > RELEASE) return false;
  uint16_t watchdog = get16(body);
  if (watchdog < LEAST_WATCHDOG || watchdog > MOST_WATCHDOG) return false;
  for (uint8_t c = 0; c < CHANNELS; c++) if (!get16(body + 6 + 4 * c)) return false;
  if (state == ARMED) return true; /* nobody changes what is safe under way */
  watchdog_ms = (uint8_t)watchdog;
  reach = (Reach)body[2];
  for (uint8_t c = 0; c < CHANNELS; c++) {
    safe_counts[c] = get16(body + 4 + 4 * c);
    slew[c] = get16(body + 6 + 4 * c);
    if (!pose_known) counts[c] = pulsed[c] = target[c] = safe_counts[c]; /* no pulses go out */
  }
  state = CONFIGURED;
  return true;
}

static void arm() {
  if (state != CONFIGURED) return;
  for (uint8_t c = 0; c < CHANNELS; c++) {
    target[c] = counts[c];
    move_to(c, target[c]);
  }
  state = ARMED;
  homing = false;
  pose_known = pulsing = true;
  power(true);
}

static void take_command(const uint8_t *body, uint8_t size, uint16_t sequence) {
  if (size != 5 + 2 * CHANNELS) return say_no(session, sequence, MALFORMED);
  if (state != ARMED) return say_no(session, sequence, NOT_ARMED);
  uint32_t when = get32(body);
  bool timed = body[4] & 1, now = !timed || (int32_t)(when - chip_us()) < 0;
  if (!now && queued == QUEUE) return say_no(session, sequence, QUEUE_FULL);
  received++;
  if (now) queued = 0;
  uint8_t last = (uint8_t)((queue_first + queued) % QUEUE);
  memcpy(now ? target : queue_counts[last], body + 5, 2 * CHANNELS); /* both little-endian */
  if (!now) {
    queue_when[last] = when;
    queued++;
  } else if (timed) {
    late++;
    say_no(session, sequence, LATE);
  }
}

/* Take a packet of the session; true: it was well-formed. */
static bool take_own(uint8_t kind, const uint8_t *body, uint8_t size, uint16_t sequence) {
  switch (kind) {
    case HELLO:
      if (size != 10) return false;
      say_welcome();
      return true;
    case SYNC:
      if (size != 4) return false;
      say_synced(get32(body));
      return true;
    case COMMAND: take_command(body, size, sequence); return true;
    case CONFIGURE:
      if (!configure(body, size)) return false;
      break;
    case ARM:
      if (size) return false;
      arm();
      break;
    case TO_SAFE: go_safe(); break; /* whatever else it may hold */
    default: return false;
  }
  say_state(kind);
  return true;
}

static void take_packet(const uint8_t *data, uint8_t size) {
  uint8_t kind = data[0], from = data[1];
  uint16_t sequence = get16(data + 2);
  const uint8_t *body = data + 4;
  size -= 4;
  if (from != session || !session) { /* another sender: it may begin where nobody is armed */
    if (kind != HELLO || state == ARMED) return say_no(from, sequence, OTHER_SESSION);
    if (size != 10 || !from) return say_no(from, sequence, MALFORMED);
    session = from;
    state = IDLE;
    queued = 0;
    sequence_in = sequence - 1;
  }
  uint16_t ahead = sequence - sequence_in;
  if (ahead == 0 || ahead > WINDOW) return; /* a copy, overtaken, or out of another time: no sign of life */
  if (ahead > 1) {
    lost = (uint16_t)(lost + ahead - 1);
    say_no(session, sequence, GAP);
  }
  sequence_in = sequence;
  heard = chip_ms();
  if (!take_own(kind, body, size, sequence)) say_no(session, sequence, MALFORMED);
}

/* Take what has come in: so many bytes and one packet at most, the rest in the next loop. */
static void receive() {
  for (uint8_t n = 0; n < BYTES_A_LOOP && chip_line_waiting(); n++) {
    Found found = take_byte(chip_line_take());
    if (found == NOTHING) continue;
    if (found == WHOLE) return take_packet(packet, whole_size - 4);
    damaged++;
    return say_no(session, sequence_in, DAMAGED);
  }
}

void setup() {
#ifdef DERMIS_RELAY_PIN
  chip_relay_begin(DERMIS_RELAY_PIN);
#endif
  power(false);
  begin_pulses();
  chip_line_begin(DERMIS_BAUD);
  begin_watchdog();
}

void loop() {
  receive();
  if (state == ARMED && chip_ms() - heard > watchdog_ms) {
    watchdogs++;
    go_safe();
  }
  play();
  uint8_t steps = passed();
  if (steps && state == ARMED) {
    for (uint8_t c = 0; c < CHANNELS; c++) approach(c, target[c], slew[c]);
  }
  if (steps && homing) go_home(steps);
  alive();
}
