/* The native protocol, version 2 (presets/streaming_protocol.md): who may move what, when, how fast, and what ends it. */
#pragma once
#include "frames.h"
#include "last_resort.h"
#include "movement.h"
#include <string.h>

static const uint8_t VERSION = 2;
static const uint16_t FITS = CHIP_QUEUE_BYTES / (4 + 2 * CHANNELS);
static const uint8_t QUEUE = FITS < 255 ? FITS : 255; /* 1000 bytes hold 125 commands of two channels, 50 of eight */
static_assert(QUEUE >= 1, "CHIP_QUEUE_BYTES: not one command fits");
static_assert(sizeof DERMIS_ID == 9, "DERMIS_ID has eight characters");
static_assert(chip_line_baud(DERMIS_BAUD), "DERMIS_BAUD: the chip's clock does not divide into this rate");

/* Whatever comes in, the loop comes round to its watchdog and its limits: in 1.5 ms at the worst (emulated). */
static const uint8_t BYTES_A_LOOP = 16;
static const uint8_t NACK_EVERY = 5; /* ms */
static const uint16_t WINDOW = 1024; /* packets: what is further ahead was not lost on the way, it is old */
static const uint8_t LEAST_WATCHDOG = 10; /* ms of silence that a sender may ask for; the longest is MOST_WATCHDOG */
static_assert(CHIP_WATCHDOG_MS > MOST_WATCHDOG, "the chip's reset must come after the way to safety has begun");

enum Kind : uint8_t {
  HELLO = 1, CONFIGURE, ARM, TO_SAFE, COMMAND, SYNC, WELCOME = 0x81, STATE = 0x85, SYNCED, NACK
};
enum State : uint8_t { IDLE, CONFIGURED, ARMED, SAFE };
enum Reach : uint8_t { AT_ONCE, RAMP, RELEASE };
enum Reason : uint8_t { DAMAGED = 1, GAP, NOT_ARMED, QUEUE_FULL, OTHER_SESSION, LATE, MALFORMED };

static State state = IDLE;
static Reach reach = RAMP;
static uint8_t session = 0; /* nobody's */
static uint16_t sequence_in = 0;
static uint16_t received = 0, lost = 0, damaged = 0, late = 0, watchdogs = 0;
static uint16_t watchdog_ms = 50;
static uint16_t safe_counts[CHANNELS], slew[CHANNELS];
static uint32_t heard = 0;

static uint32_t queue_when[QUEUE];
static uint16_t queue_counts[QUEUE][CHANNELS];
static uint8_t queue_first = 0, queued = 0;

/* -- safe state and queue */

static void go_safe() {
  if (state == IDLE) return;
  queued = 0;
  state = SAFE;
  if (homing) return; /* a second SAFE, whoever sends it, changes neither speed nor end of the way */
  if (reach == RELEASE) let_go();
  else begin_way(safe_counts, slew, reach == AT_ONCE);
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
  watchdog_ms = watchdog;
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
  if (state != CONFIGURED || !pulses_ready) return;
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
  for (uint8_t n = 0; n < BYTES_A_LOOP && line_waiting(); n++) {
    Found found = take_byte(line_take());
    if (found == NOTHING) continue;
    if (found == WHOLE) return take_packet(packet, whole_size - 4);
    damaged++;
    return say_no(session, sequence_in, DAMAGED);
  }
}

void setup() {
  begin_power();
  begin_pulses();
  line_begin();
  begin_watchdog();
}

void loop() {
  serve_line(state == ARMED, pulsing);
  receive();
  if (state == ARMED && chip_ms() - heard > watchdog_ms) {
    watchdogs++;
    go_safe();
  }
  serve_pulses();
  if (pulsing && !pulses_ready) { /* a board that makes them is gone */
    if (state == ARMED) state = SAFE;
    let_go();
  }
  play();
  uint8_t steps = passed();
  if (steps && state == ARMED) {
    for (uint8_t c = 0; c < CHANNELS; c++) approach(c, target[c], slew[c]);
  }
  if (steps && homing) go_home(steps);
  alive();
}
