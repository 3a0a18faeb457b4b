/* Datagrams that only the host that was paired can make: BLAKE2s (RFC 7693) keyed with a secret that came over USB.

   Each datagram: "DU", kind u8, its fields, 16 bytes of BLAKE2s over all before. H and B: 16 random bytes of host and board.
     1 ASK     H                               under the pairing's key
     2 OFFER   H, B                            under the pairing's key
     3 OPEN    H, B                            under the pairing's key
     4 DATA    counter u32, stamp u32, bytes   to the board, under the session's key
     5 DATA    counter u32, clock u32, bytes   from the board, under the session's key
     6 BUSY    H                               under the pairing's key: it is armed for another session
   The session's key is BLAKE2s("dermis session", H, B) under the pairing's. B counts once, so a recording opens nothing;
   counters only rise; `stamp` is the board's newest clock [ms] that the host has heard, so what somebody holds back for longer
   than FRESH_MS is worth nothing. Without the key nothing here changes but the bytes that an ASK again and again is answered
   with. Nothing is kept secret: who listens can read every command. */
#pragma once
#include "chip.h"
#include <stdint.h>
#include <string.h>

static const uint8_t KEY_SIZE = 32, SEAL_SIZE = 16, NONCE_SIZE = 16;

/* -- BLAKE2s */

struct Blake2s {
  uint32_t h[8], counted;
  uint8_t block[64], filled;
};

static const uint32_t BLAKE_START[8] = {0x6a09e667u, 0xbb67ae85u, 0x3c6ef372u, 0xa54ff53au,
                                        0x510e527fu, 0x9b05688cu, 0x1f83d9abu, 0x5be0cd19u};
static const uint8_t BLAKE_ORDER[10][16] = {
    {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}, {14, 10, 4, 8, 9, 15, 13, 6, 1, 12, 0, 2, 11, 7, 5, 3},
    {11, 8, 12, 0, 5, 2, 15, 13, 10, 14, 3, 6, 7, 1, 9, 4}, {7, 9, 3, 1, 13, 12, 11, 14, 2, 6, 5, 10, 4, 0, 15, 8},
    {9, 0, 5, 7, 2, 4, 10, 15, 14, 1, 11, 12, 6, 8, 3, 13}, {2, 12, 6, 10, 0, 11, 8, 3, 4, 13, 7, 5, 15, 14, 1, 9},
    {12, 5, 1, 15, 14, 13, 4, 10, 0, 7, 6, 3, 9, 2, 8, 11}, {13, 11, 7, 14, 12, 1, 3, 9, 5, 0, 15, 4, 8, 6, 2, 10},
    {6, 15, 14, 9, 11, 3, 0, 8, 12, 2, 13, 7, 1, 4, 10, 5}, {10, 2, 8, 4, 7, 6, 1, 5, 15, 11, 9, 14, 3, 12, 13, 0}};

static uint32_t word_at(const uint8_t *p) {
  return (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}
static void put_word(uint8_t *p, uint32_t v) {
  for (uint8_t i = 0; i < 4; i++) p[i] = (uint8_t)(v >> 8 * i);
}
static uint32_t turned(uint32_t v, uint8_t by) { return v >> by | v << (32 - by); }

static void blake_mix(uint32_t *v, uint8_t a, uint8_t b, uint8_t c, uint8_t d, uint32_t x, uint32_t y) {
  v[a] += v[b] + x;
  v[d] = turned(v[d] ^ v[a], 16);
  v[c] += v[d];
  v[b] = turned(v[b] ^ v[c], 12);
  v[a] += v[b] + y;
  v[d] = turned(v[d] ^ v[a], 8);
  v[c] += v[d];
  v[b] = turned(v[b] ^ v[c], 7);
}

static void blake_compress(Blake2s &s, bool last) {
  uint32_t v[16], m[16];
  for (uint8_t i = 0; i < 8; i++) v[i] = s.h[i], v[i + 8] = BLAKE_START[i];
  v[12] ^= s.counted;
  if (last) v[14] = ~v[14];
  for (uint8_t i = 0; i < 16; i++) m[i] = word_at(s.block + 4 * i);
  for (uint8_t round = 0; round < 10; round++) {
    const uint8_t *o = BLAKE_ORDER[round];
    for (uint8_t i = 0; i < 4; i++) blake_mix(v, i, (uint8_t)(4 + i), (uint8_t)(8 + i), (uint8_t)(12 + i), m[o[2 * i]], m[o[2 * i + 1]]);
    for (uint8_t i = 0; i < 4; i++)
      blake_mix(v, i, (uint8_t)(4 + (i + 1) % 4), (uint8_t)(8 + (i + 2) % 4), (uint8_t)(12 + (i + 3) % 4), m[o[8 + 2 * i]], m[o[9 + 2 * i]]);
  }
  for (uint8_t i = 0; i < 8; i++) s.h[i] ^= v[i] ^ v[i + 8];
}

static void blake_add(Blake2s &s, const uint8_t *bytes, uint16_t size) {
  while (size--) {
    if (s.filled == sizeof s.block) {
      s.counted += sizeof s.block;
      blake_compress(s, false);
      s.filled = 0;
    }
    s.block[s.filled++] = *bytes++;
  }
}

/* Begin a hash of `size` bytes under a key of KEY_SIZE. */
static void blake_begin(Blake2s &s, const uint8_t *key, uint8_t size) {
  memcpy(s.h, BLAKE_START, sizeof s.h);
  s.h[0] ^= 0x01010000u ^ (uint32_t)KEY_SIZE << 8 ^ size;
  s.counted = 0;
  memset(s.block, 0, sizeof s.block);
  memcpy(s.block, key, KEY_SIZE);
  s.filled = sizeof s.block;
}

static void blake_end(Blake2s &s, uint8_t *out, uint8_t size) {
  s.counted += s.filled;
  memset(s.block + s.filled, 0, sizeof s.block - s.filled);
  blake_compress(s, true);
  for (uint8_t i = 0; i < size; i++) out[i] = (uint8_t)(s.h[i / 4] >> 8 * (i % 4));
}

static void hash(const uint8_t *key, const uint8_t *bytes, uint16_t count, uint8_t *to, uint8_t size) {
  Blake2s s;
  blake_begin(s, key, size);
  blake_add(s, bytes, count);
  blake_end(s, to, size);
}

/* -- datagrams */

enum Sealed : uint8_t { SEAL_ASK = 1, SEAL_OFFER, SEAL_OPEN, SEAL_TO_BOARD, SEAL_FROM_BOARD, SEAL_BUSY };
static const uint16_t FRESH_MS = 200;
static const uint8_t SEAL_HEAD = 11; /* of DATA: "DU", kind, counter, stamp */
static const uint16_t PAYLOAD = 256;
static const uint16_t DATAGRAM = SEAL_HEAD + PAYLOAD + SEAL_SIZE;

static uint8_t pair_key[KEY_SIZE], session_key[KEY_SIZE];
static bool paired = false, opened = false;
static uint8_t offer[NONCE_SIZE], opened_by[2 * NONCE_SIZE]; /* H and B of the session */
static ChipPeer peer;
static uint32_t counter_in = 0, counter_out = 0;
static uint8_t datagram[DATAGRAM]; /* the last one that came */
static uint8_t answer[DATAGRAM];

static void seal_and_send(const ChipPeer &to, const uint8_t *key, uint16_t size) {
  hash(key, answer, size, answer + size, SEAL_SIZE);
  chip_udp_send(to, answer, (uint16_t)(size + SEAL_SIZE));
}

static bool seal_holds(const uint8_t *key, uint16_t size) {
  uint8_t seal[SEAL_SIZE], differs = 0;
  hash(key, datagram, (uint16_t)(size - SEAL_SIZE), seal, SEAL_SIZE);
  for (uint8_t i = 0; i < SEAL_SIZE; i++) differs = (uint8_t)(differs | (seal[i] ^ datagram[size - SEAL_SIZE + i]));
  return !differs;
}

static void begin_seals(const uint8_t *key) {
  memcpy(pair_key, key, KEY_SIZE);
  chip_random(offer, NONCE_SIZE);
  paired = true;
}

/* Send bytes of a session: answer[SEAL_HEAD] and so on hold them already. */
static void seal_data(uint16_t size) {
  if (!opened) return;
  memcpy(answer, "DU", 2);
  answer[2] = SEAL_FROM_BOARD;
  put_word(answer + 3, ++counter_out);
  put_word(answer + 7, chip_ms());
  seal_and_send(peer, session_key, (uint16_t)(SEAL_HEAD + size));
}

static void answer_with(const ChipPeer &from, uint8_t kind) {
  memcpy(answer, "DU", 2);
  answer[2] = kind;
  memcpy(answer + 3, datagram + 3, NONCE_SIZE);
  memcpy(answer + 3 + NONCE_SIZE, offer, NONCE_SIZE);
  seal_and_send(from, pair_key, (uint16_t)(3 + (kind == SEAL_OFFER ? 2 : 1) * NONCE_SIZE));
}

static void open_session(const ChipPeer &from, bool held) {
  const uint8_t *nonces = datagram + 3;
  bool same = opened && memcmp(opened_by, nonces, sizeof opened_by) == 0;
  if (!same) {
    if (memcmp(offer, nonces + NONCE_SIZE, NONCE_SIZE) != 0) return; /* a recording, or too late */
    if (held) return answer_with(from, SEAL_BUSY);
    uint8_t words[14 + 2 * NONCE_SIZE];
    memcpy(words, "dermis session", 14);
    memcpy(words + 14, nonces, 2 * NONCE_SIZE);
    hash(pair_key, words, sizeof words, session_key, KEY_SIZE);
    memcpy(opened_by, nonces, sizeof opened_by);
    chip_random(offer, NONCE_SIZE);
    peer = from;
    counter_in = counter_out = 0;
    opened = true;
  } else if (!(peer == from)) {
    return;
  }
  seal_data(0); /* it is open; said again, as the first word may have been lost */
}

/* Take the datagram of so many bytes that has come; return how many bytes of a session are at datagram + SEAL_HEAD. `held`:
   the session in force may not be taken over. */
static uint16_t take_datagram(const ChipPeer &from, uint16_t size, bool held) {
  if (!paired || size < SEAL_HEAD + SEAL_SIZE || memcmp(datagram, "DU", 2) != 0) return 0;
  switch (datagram[2]) {
    case SEAL_ASK:
      if (size == 3 + NONCE_SIZE + SEAL_SIZE && seal_holds(pair_key, size)) answer_with(from, held ? SEAL_BUSY : SEAL_OFFER);
      return 0;
    case SEAL_OPEN:
      if (size == 3 + 2 * NONCE_SIZE + SEAL_SIZE && seal_holds(pair_key, size)) open_session(from, held);
      return 0;
    case SEAL_TO_BOARD: break;
    default: return 0;
  }
  if (!opened || !(peer == from) || !seal_holds(session_key, size)) return 0;
  uint32_t counter = word_at(datagram + 3);
  if (counter <= counter_in) return 0; /* a copy, or overtaken */
  counter_in = counter;
  if (chip_ms() - word_at(datagram + 7) > FRESH_MS) { /* held back, or the host has heard nothing for long: it hears the clock */
    seal_data(0);
    return 0;
  }
  return (uint16_t)(size - SEAL_HEAD - SEAL_SIZE);
}
