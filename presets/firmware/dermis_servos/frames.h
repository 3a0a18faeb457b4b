/* Frames of the native protocol: zero, COBS of packet and CRC-32, zero. Each byte costs the same few cycles when it
   comes, so that whoever counts bytes has counted the work; an answer leaves whole at once, or not at all. */
#pragma once
#include "line.h"
#include <stdint.h>

#ifdef DERMIS_PCA9685
static const uint16_t MOST_SERVOS = DERMIS_CHANNELS;
#else
static const uint16_t MOST_SERVOS = CHIP_SERVOS;
#endif
static const uint8_t LARGEST = (uint8_t)(12 + 4 * MOST_SERVOS); /* bytes of a CONFIGURE with its check sum: nothing is longer */
static_assert(12 + 4 * MOST_SERVOS < 254, "a CONFIGURE of so many channels needs wider counters");
static_assert(LARGEST >= 18, "a HELLO must fit, too");

/* CRC-32 a byte at a time: at half a million baud there are 320 cycles for each, and half of them are the receiver's. */
static constexpr uint32_t crc_of(uint32_t crc, uint8_t bits) {
  return bits ? crc_of(crc & 1 ? 0xedb88320 ^ crc >> 1 : crc >> 1, bits - 1) : crc;
}
#define CRC4(n) crc_of(n, 8), crc_of(n + 1, 8), crc_of(n + 2, 8), crc_of(n + 3, 8)
#define CRC16(n) CRC4(n), CRC4(n + 4), CRC4(n + 8), CRC4(n + 12)
#define CRC64(n) CRC16(n), CRC16(n + 16), CRC16(n + 32), CRC16(n + 48)
static const uint32_t CRC_OF_BYTE[256] CHIP_FLASH = {CRC64(0), CRC64(64), CRC64(128), CRC64(192)};
static const uint32_t CRC_OF_WHOLE = 0xdebb20e3; /* of anything followed by its own check sum */

static inline uint32_t crc_step(uint32_t crc, uint8_t byte) {
  return chip_flash32(&CRC_OF_BYTE[(uint8_t)crc ^ byte]) ^ crc >> 8;
}

static uint16_t get16(const uint8_t *p) { return (uint16_t)p[0] | (uint16_t)p[1] << 8; }
static uint32_t get32(const uint8_t *p) { return get16(p) | (uint32_t)get16(p + 2) << 16; }

/* -- in */

enum Found : uint8_t { NOTHING, WHOLE, BAD };

static uint8_t packet[LARGEST]; /* as it comes, and whole until the next byte is taken; with its check sum */
static uint8_t packet_size = 0, whole_size = 0;
static uint32_t packet_crc = 0xffffffff;
static uint8_t block = 0; /* bytes of a COBS block still to come */
static bool begun = false, zero_due = false;

__attribute__((always_inline)) static inline void put_in(uint8_t byte) {
  if (packet_size >= LARGEST) {
    packet_size = LARGEST + 1; /* too long */
    return;
  }
  packet[packet_size++] = byte;
  packet_crc = crc_step(packet_crc, byte);
}

static Found end_packet() {
  bool good = block == 0 && packet_size >= 8 && packet_size <= LARGEST && packet_crc == CRC_OF_WHOLE;
  Found found = !begun ? NOTHING : good ? WHOLE : BAD;
  whole_size = packet_size;
  packet_crc = 0xffffffff;
  packet_size = block = 0;
  begun = zero_due = false;
  return found;
}

/* Take a byte of the line; WHOLE: `packet` holds `whole_size` bytes. */
__attribute__((always_inline)) static inline Found take_byte(uint8_t byte) {
  if (byte == 0) return end_packet();
  if (block) {
    block--;
    put_in(byte);
    return NOTHING;
  }
  if (zero_due) put_in(0);
  block = byte - 1;
  begun = true;
  zero_due = byte != 255;
  return NOTHING;
}

/* -- out */

static const uint8_t MOST_OUT = (uint8_t)(4 + 27 + 2 * MOST_SERVOS + 4); /* header, body and check sum of a WELCOME: no answer is longer */
static_assert(4 + 27 + 2 * MOST_SERVOS + 4 < 254, "an answer of 254 bytes needs a second block of COBS");
static_assert(MOST_OUT + 3 <= LINE_ROOM, "the longest answer must fit into the line's buffer, or it never leaves");

static uint8_t out[MOST_OUT];
static uint8_t out_size;
static uint16_t sequence_out = 0;

static void put8(uint8_t v) { out[out_size++] = v; }
static void put16(uint16_t v) { put8((uint8_t)v); put8((uint8_t)(v >> 8)); }
static void put32(uint32_t v) { put16((uint16_t)v); put16((uint16_t)(v >> 16)); }

/* Begin an answer, if the transmitter has room for all of it. If not it is dropped: its number stays used, so that the
   sender can count it. */
static bool begin_answer(uint8_t kind, uint8_t session, uint8_t body_size) {
  sequence_out++;
  if (line_room() < (uint16_t)(body_size + 11)) return false; /* header 4, check sum 4, COBS 1, two zeros */
  out_size = 0;
  put8(kind);
  put8(session);
  put16(sequence_out);
  return true;
}

static void end_answer() {
  uint32_t crc = 0xffffffff;
  for (uint8_t i = 0; i < out_size; i++) crc = crc_step(crc, out[i]);
  put32(~crc);
  line_put(0);
  for (uint8_t at = 0; at <= out_size; at++) { /* COBS; no packet of this board reaches 254 bytes */
    uint8_t n = 0;
    while (at + n < out_size && out[at + n]) n++;
    line_put(n + 1);
    while (n--) line_put(out[at++]);
  }
  line_put(0);
  line_send();
}
