/* Pairing over USB, in lines of text at PAIR_BAUD, so that a terminal shows what goes on:
     "pair KEY NETWORK PASSWORD"  hexadecimal, 32, 1 to 32 and 0 to 63 bytes ("-" for none); it is kept in flash, and the board
                                  begins anew. Answer: "paired ID CHECK", the check is 8 bytes of BLAKE2s("dermis paired")
                                  under the key as it was read back; or "refused WHY"
     "where"                      answer: "at ID ADDRESS PORT", the address as four bytes, hexadecimal: zeros while the network has
                                  given none; or "unpaired ID"
   A new pairing replaces the old one, so one host at a time is paired. The key is never said again. */
#pragma once
#include "sealed.h"

static const uint32_t PAIR_BAUD = 115200;
static const uint8_t PAIR_NETWORK = KEY_SIZE, PAIR_PASSWORD = PAIR_NETWORK + 33, PAIR_RECORD = PAIR_PASSWORD + 64;
static const uint16_t PAIR_LINE = 5 + 2 * KEY_SIZE + 1 + 64 + 1 + 126 + 1;
static const uint8_t PAIR_BYTES_A_LOOP = 16;
static const uint16_t RESTART_MS = 100; /* until the answer is out */

static char pair_line[PAIR_LINE];
static uint16_t pair_filled = 0;
static bool pair_restarts = false;
static uint32_t pair_since = 0;

static void tell(const char *text) {
  while (*text && chip_line_room()) chip_line_put((uint8_t)*text++);
}

static void tell_hex(const uint8_t *bytes, uint8_t size) {
  for (uint8_t i = 0; i < 2 * size && chip_line_room(); i++)
    chip_line_put((uint8_t) "0123456789abcdef"[bytes[i / 2] >> (i % 2 ? 0 : 4) & 15]);
}

static void told() {
  tell("\n");
  chip_line_send();
}

static int nibble(char c) {
  return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
}

/* Read a word of hexadecimal digits up to `end`; return where the next begins, or NULL where it is none. */
static const char *read_hex(const char *at, char end, uint8_t *to, uint8_t least, uint8_t most) {
  uint8_t size = 0;
  if (*at == '-') at++;
  else
    for (; nibble(at[0]) >= 0 && nibble(at[1]) >= 0; at += 2) {
      if (size == most) return nullptr;
      to[size++] = (uint8_t)(nibble(at[0]) << 4 | nibble(at[1]));
    }
  return *at == end && size >= least ? at + (end ? 1 : 0) : nullptr;
}

static void take_pair(const char *at, bool moving) {
  uint8_t record[PAIR_RECORD] = {0}, kept[PAIR_RECORD] = {0}, check[8];
  at = read_hex(at, ' ', record, KEY_SIZE, KEY_SIZE);
  if (at) at = read_hex(at, ' ', record + PAIR_NETWORK, 1, 32);
  if (at) at = read_hex(at, 0, record + PAIR_PASSWORD, 0, 63);
  if (moving) tell("refused moving"); /* writing into flash stops the pulses' interrupt */
  else if (!at) tell("refused malformed");
  else if (!chip_keep(record, sizeof record) || !chip_kept(kept, sizeof kept) || memcmp(record, kept, sizeof kept) != 0) tell("refused flash");
  else {
    hash(kept, (const uint8_t *)"dermis paired", 13, check, sizeof check);
    tell("paired " DERMIS_ID " ");
    tell_hex(check, sizeof check);
    pair_restarts = true;
    pair_since = chip_ms();
  }
  told();
}

static void take_pair_line(bool moving) {
  if (strncmp(pair_line, "pair ", 5) == 0) return take_pair(pair_line + 5, moving);
  if (strcmp(pair_line, "where") != 0) return; /* a terminal's noise */
  uint32_t address = chip_wifi_address();
  uint8_t bytes[4], port[2] = {(uint8_t)(DERMIS_UDP_PORT >> 8), (uint8_t)DERMIS_UDP_PORT};
  memcpy(bytes, &address, 4);
  if (paired) {
    tell("at " DERMIS_ID " ");
    tell_hex(bytes, 4);
    tell(" ");
    tell_hex(port, 2);
  } else {
    tell("unpaired " DERMIS_ID);
  }
  told();
}

static void serve_pairing(bool moving) {
  if (pair_restarts && chip_ms() - pair_since >= RESTART_MS) {
    pair_restarts = false;
    if (!moving) chip_restart();
  }
  for (uint8_t n = 0; n < PAIR_BYTES_A_LOOP && chip_line_waiting(); n++) {
    char c = (char)chip_line_take();
    if (c == '\n' || c == '\r') {
      if (pair_filled < PAIR_LINE) {
        pair_line[pair_filled] = 0;
        if (pair_filled) take_pair_line(moving);
      }
      memset(pair_line, 0, sizeof pair_line); /* no key stays in memory longer than it is needed */
      pair_filled = 0;
      return;
    }
    if (pair_filled < PAIR_LINE) pair_line[pair_filled++] = c; /* PAIR_LINE: too long, up to its end */
  }
}
