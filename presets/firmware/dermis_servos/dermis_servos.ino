/* Dermis: eight hobby servos on an Arduino Uno (or any board with an ATmega328P at 16 MHz).

   Speaks the native protocol, version 2 (presets/streaming.md), at 115200 baud. Built with
   -DDERMIS_SERVO_ANIMATION it receives Blender Servo Animation's live mode instead, positions in microseconds.

   Pins 2 to 9 are channels 0 to 7; wiring in README.md beside this file. A pulse is 1000 us for count 0 and 2000 us
   for count 65535. No pulse leaves the board before it has been armed. When nothing valid has arrived for as long as
   the sender asked for (70 ms, if it says nothing else), the board goes to its safe state by itself.

   Needs nothing but the Arduino core: pulses come from timer 1, so pins 9 and 10 have no analogWrite().
*/
#include <Arduino.h>
#include <avr/interrupt.h>
#include <avr/pgmspace.h>

#ifndef DERMIS_CHANNELS
#define DERMIS_CHANNELS 8 /* as many as your device preset drives, 1 to 8 */
#endif

static const uint8_t CHANNELS = DERMIS_CHANNELS;
static const uint8_t FIRST_PIN = 2;
static const uint8_t QUEUE = 8;
static const uint16_t SHORTEST = 2000; /* timer ticks of 0.5 us: 1000 us */
static const uint16_t SPAN = 2000;     /* 1000 us more */
static const uint16_t SLOT = 40000u / CHANNELS; /* 2.5 ms a channel for eight of them, 20 ms for all */
static const uint16_t EARLY = 50;      /* ticks: the interrupt comes early and then waits, so that no other delays it */

enum State : uint8_t { IDLE, CONFIGURED, ARMED, SAFE };
enum Reach : uint8_t { AT_ONCE, RAMP, RELEASE };

/* -- pulses: one channel after the other, both edges timed to the tick */

static volatile uint16_t ticks[CHANNELS]; /* of each pulse */
static volatile bool pulsing = false;
static volatile uint8_t *ports[CHANNELS];
static uint8_t masks[CHANNELS];
static uint8_t slot_channel = 0;
static bool high = false;
static uint16_t slot_start = 0, edge = 0;

ISR(TIMER1_COMPA_vect) {
  volatile uint8_t *port = ports[slot_channel];
  uint8_t mask = masks[slot_channel];
  while ((int16_t)(TCNT1 - edge) < 0) {}
  if (high) {
    *port &= (uint8_t)~mask;
    high = false;
    slot_channel = (uint8_t)((slot_channel + 1) % CHANNELS);
    slot_start += SLOT;
    edge = slot_start;
  } else if (pulsing) {
    *port |= mask;
    high = true;
    edge = slot_start + ticks[slot_channel];
  } else {
    slot_channel = (uint8_t)((slot_channel + 1) % CHANNELS);
    slot_start += SLOT;
    edge = slot_start;
  }
  OCR1A = edge - EARLY;
}

static void set_ticks(uint8_t channel, uint16_t value) {
  uint8_t before = SREG;
  cli();
  ticks[channel] = value;
  SREG = before;
}

static void begin_pulses() {
  for (uint8_t c = 0; c < CHANNELS; c++) {
    pinMode(FIRST_PIN + c, OUTPUT);
    digitalWrite(FIRST_PIN + c, LOW);
    ports[c] = portOutputRegister(digitalPinToPort(FIRST_PIN + c));
    masks[c] = digitalPinToBitMask(FIRST_PIN + c);
    ticks[c] = SHORTEST + SPAN / 2;
  }
  cli();
  TCCR1A = 0;
  TCCR1B = _BV(CS11); /* a tick is 8 clocks, 0.5 us */
  slot_start = edge = TCNT1 + SLOT;
  OCR1A = edge - EARLY;
  TIFR1 = _BV(OCF1A);
  TIMSK1 = _BV(OCIE1A);
  sei();
}

#ifdef DERMIS_SERVO_ANIMATION

/* -- Blender Servo Animation: 0x3C, id, position high, position low, 0x3E; every 0x3C starts anew, as in the original */

static uint8_t command[5], filled = 0;
static uint32_t heard = 0;

void setup() {
  begin_pulses();
  Serial.begin(115200);
}

void loop() {
  while (Serial.available()) {
    uint8_t byte = (uint8_t)Serial.read();
    if (byte == 0x3C) filled = 0;
    if (filled < 5) command[filled++] = byte;
    if (filled == 5 && command[0] == 0x3C && command[4] == 0x3E) {
      uint16_t us = (uint16_t)command[2] << 8 | command[3];
      if (command[1] < CHANNELS && us >= 1000 && us <= 2000) {
        set_ticks(command[1], us * 2);
        pulsing = true;
        heard = millis();
      }
      filled = 6; /* nothing more before the next start */
    }
  }
  if (pulsing && millis() - heard > 500) pulsing = false; /* the original has no watchdog; servos let go here */
}

#else

/* -- the native protocol */

enum Kind : uint8_t {
  HELLO = 1, CONFIGURE, ARM, TO_SAFE, COMMAND, SYNC, WELCOME = 0x81, STATE = 0x85, SYNCED, NACK
};
enum Reason : uint8_t { DAMAGED = 1, GAP, NOT_ARMED, QUEUE_FULL, OTHER_SESSION, LATE, MALFORMED };

static uint16_t ticks_of(uint16_t count) {
  return SHORTEST + (uint16_t)(((uint32_t)count * SPAN + 32767u) / 65535u);
}

static const uint8_t VERSION = 2;
static const uint8_t LARGEST = 96; /* a CONFIGURE of eight channels has 44 bytes with its stuffing */

static uint8_t frame[LARGEST];
static uint8_t frame_size = 0;
static bool frame_too_long = false;

static State state = IDLE;
static Reach reach = RAMP;
static uint8_t session = 0;
static bool sequence_known = false, pose_known = false;
static uint16_t sequence_in = 0, sequence_out = 0;
static uint16_t received = 0, lost = 0, damaged = 0, late = 0, watchdogs = 0;
static uint16_t watchdog_ms = 70;
static uint16_t counts[CHANNELS], target[CHANNELS], safe_counts[CHANNELS], slew[CHANNELS];
static uint32_t heard = 0, stepped = 0;

static uint32_t queue_when[QUEUE];
static uint16_t queue_counts[QUEUE][CHANNELS];
static uint8_t queue_first = 0, queued = 0;

static const uint32_t CRC_OF_NIBBLE[16] PROGMEM = {
  0x00000000, 0x1db71064, 0x3b6e20c8, 0x26d930ac, 0x76dc4190, 0x6b6b51f4, 0x4db26158, 0x5005713c,
  0xedb88320, 0xf00f9344, 0xd6d6a3e8, 0xcb61b38c, 0x9b64c2b0, 0x86d3d2d4, 0xa00ae278, 0xbdbdf21c
};

static uint32_t crc32(const uint8_t *data, uint8_t size) {
  uint32_t crc = 0xffffffff;
  while (size--) {
    crc ^= *data++;
    crc = pgm_read_dword(&CRC_OF_NIBBLE[crc & 15]) ^ (crc >> 4);
    crc = pgm_read_dword(&CRC_OF_NIBBLE[crc & 15]) ^ (crc >> 4);
  }
  return ~crc;
}

static uint16_t get16(const uint8_t *p) { return (uint16_t)p[0] | (uint16_t)p[1] << 8; }
static uint32_t get32(const uint8_t *p) { return get16(p) | (uint32_t)get16(p + 2) << 16; }

static uint8_t out[64];
static uint8_t out_size;

static void begin_packet(Kind kind, uint8_t to_session) {
  sequence_out++;
  out[0] = kind;
  out[1] = to_session;
  out[2] = (uint8_t)sequence_out;
  out[3] = (uint8_t)(sequence_out >> 8);
  out_size = 4;
}
static void put8(uint8_t v) { out[out_size++] = v; }
static void put16(uint16_t v) { put8((uint8_t)v); put8((uint8_t)(v >> 8)); }
static void put32(uint32_t v) { put16((uint16_t)v); put16((uint16_t)(v >> 16)); }

static void end_packet() {
  put32(crc32(out, out_size));
  Serial.write((uint8_t)0);
  uint8_t at = 0;
  for (;;) { /* COBS; no packet of this board reaches 254 bytes */
    uint8_t n = 0;
    while (at + n < out_size && out[at + n]) n++;
    Serial.write((uint8_t)(n + 1));
    Serial.write(out + at, n);
    at += n;
    if (at >= out_size) break;
    at++;
  }
  Serial.write((uint8_t)0);
}

static void say_no(uint8_t to_session, uint16_t sequence, Reason reason) {
  begin_packet(NACK, to_session);
  put16(sequence);
  put8(reason);
  end_packet();
}

static void go_safe() {
  if (state == IDLE) return;
  queued = 0;
  state = SAFE;
  if (reach == RELEASE) pulsing = false;
}

static void hello(uint8_t from, uint16_t sequence, uint8_t size) {
  if (size != 10) return say_no(from, sequence, MALFORMED);
  if (from != session && state == ARMED) return say_no(from, sequence, OTHER_SESSION);
  if (from != session) {
    session = from;
    state = IDLE;
    queued = 0;
  }
  sequence_known = true;
  sequence_in = sequence;
  heard = millis();
  begin_packet(WELCOME, session);
  put8(VERSION);
  put8(CHANNELS);
  for (const char *id = "DERMISU1"; *id; id++) put8((uint8_t)*id);
  for (uint8_t i = 0; i < 8; i++) put8(0); /* any preset */
  put32(micros());
  put8(state);
  put8(QUEUE);
  put16(50); /* pulses a second */
  put8(pose_known);
  if (pose_known) for (uint8_t c = 0; c < CHANNELS; c++) put16(counts[c]);
  end_packet();
}

static bool configure(const uint8_t *body, uint8_t size) {
  if (size != 4 + 4 * CHANNELS || body[3] != CHANNELS || body[2] > RELEASE) return false;
  if (state == ARMED) return true; /* nobody changes what is safe under way */
  watchdog_ms = get16(body);
  if (watchdog_ms < 10 || watchdog_ms > 80) watchdog_ms = 70;
  reach = (Reach)body[2];
  for (uint8_t c = 0; c < CHANNELS; c++) {
    safe_counts[c] = get16(body + 4 + 4 * c);
    slew[c] = get16(body + 6 + 4 * c);
    if (!pose_known) counts[c] = safe_counts[c];
    target[c] = counts[c];
  }
  state = CONFIGURED;
  return true;
}

static void arm() {
  if (state != CONFIGURED && state != ARMED) return;
  for (uint8_t c = 0; c < CHANNELS; c++) set_ticks(c, ticks_of(counts[c]));
  state = ARMED;
  pose_known = pulsing = true;
}

static void take_command(const uint8_t *body, uint8_t size, uint16_t sequence) {
  if (size != 5 + 2 * CHANNELS) return say_no(session, sequence, MALFORMED);
  if (state != ARMED) return say_no(session, sequence, NOT_ARMED);
  received++;
  uint32_t when = get32(body);
  bool timed = body[4] & 1, now = !timed || (int32_t)(when - micros()) < 0;
  if (!now && queued == QUEUE) return say_no(session, sequence, QUEUE_FULL);
  if (now) queued = 0;
  uint16_t *to = now ? target : queue_counts[(queue_first + queued) % QUEUE];
  for (uint8_t c = 0; c < CHANNELS; c++) to[c] = get16(body + 5 + 2 * c);
  if (!now) {
    queue_when[(queue_first + queued) % QUEUE] = when;
    queued++;
  } else if (timed) {
    late++;
    say_no(session, sequence, LATE);
  }
}

static void take_packet(const uint8_t *data, uint8_t size) {
  uint8_t kind = data[0], from = data[1];
  uint16_t sequence = get16(data + 2);
  const uint8_t *body = data + 4;
  size -= 4;
  if (kind == HELLO) return hello(from, sequence, size);
  if (!sequence_known || from != session) return say_no(from, sequence, OTHER_SESSION);
  uint16_t ahead = sequence - sequence_in;
  if (ahead == 0 || ahead > 0x8000) return; /* a copy, or overtaken by a newer one */
  if (ahead > 1) {
    lost += ahead - 1;
    say_no(session, sequence, GAP);
  }
  sequence_in = sequence;
  heard = millis();
  switch (kind) {
    case CONFIGURE:
      if (!configure(body, size)) return say_no(session, sequence, MALFORMED);
      break;
    case ARM: arm(); break;
    case TO_SAFE: go_safe(); break;
    case COMMAND: take_command(body, size, sequence); return;
    case SYNC:
      if (size != 4) return say_no(session, sequence, MALFORMED);
      begin_packet((Kind)SYNCED, session);
      put32(get32(body));
      put32(micros());
      put8(state);
      put8(queued);
      put16(received);
      put16(lost);
      put16(damaged);
      put16(late);
      put16(watchdogs);
      end_packet();
      return;
    default: return say_no(session, sequence, MALFORMED);
  }
  begin_packet(STATE, session);
  put8(state);
  put8(kind);
  end_packet();
}

static void take_frame() {
  uint8_t at = 0, size = 0;
  bool good = !frame_too_long;
  while (good && at < frame_size) { /* COBS, in place: what is written never overtakes what is read */
    uint8_t code = frame[at++];
    if (at + code - 1 > frame_size) good = false;
    for (uint8_t i = 1; good && i < code; i++) frame[size++] = frame[at++];
    if (good && code < 255 && at < frame_size) frame[size++] = 0;
  }
  if (!good || size < 8 || crc32(frame, size - 4) != get32(frame + size - 4)) {
    damaged++;
    say_no(session, sequence_in, DAMAGED);
    return;
  }
  take_packet(frame, size - 4);
}

void setup() {
  begin_pulses();
  Serial.begin(115200);
}

static void receive() {
  while (Serial.available()) {
    uint8_t byte = (uint8_t)Serial.read();
    if (byte == 0) {
      if (frame_size || frame_too_long) take_frame();
      frame_size = 0;
      frame_too_long = false;
    } else if (frame_size == LARGEST) {
      frame_too_long = true;
    } else {
      frame[frame_size++] = byte;
    }
  }
}

/* Follow the targets, at most `slew` counts a millisecond. */
static void follow() {
  uint32_t now = millis();
  uint32_t passed = now - stepped;
  if (!passed) return;
  stepped = now;
  bool safe = state == SAFE;
  for (uint8_t c = 0; c < CHANNELS; c++) {
    uint16_t goal = safe ? safe_counts[c] : target[c];
    uint32_t most = safe && reach == AT_ONCE ? 65535u : passed * slew[c];
    uint16_t gap = goal > counts[c] ? goal - counts[c] : counts[c] - goal;
    if (gap > most) gap = (uint16_t)most;
    if (gap) {
      counts[c] = goal > counts[c] ? counts[c] + gap : counts[c] - gap;
      set_ticks(c, ticks_of(counts[c]));
    }
  }
}

void loop() {
  receive();
  if (state == ARMED && millis() - heard > watchdog_ms) {
    watchdogs++;
    go_safe();
  }
  while (queued && (int32_t)(micros() - queue_when[queue_first]) >= 0) {
    for (uint8_t c = 0; c < CHANNELS; c++) target[c] = queue_counts[queue_first][c];
    queue_first = (uint8_t)((queue_first + 1) % QUEUE);
    queued--;
  }
  if (state == ARMED || state == SAFE) follow();
}

#endif
