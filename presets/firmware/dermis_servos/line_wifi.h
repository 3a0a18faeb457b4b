/* Datagrams over Wi-Fi as the line to the sender; USB is for pairing alone. */
#pragma once
#ifndef CHIP_WIFI
#error "DERMIS_WIFI: the header of this chip has no Wi-Fi, see chip.h"
#endif
#include "pairing.h"
#include "sealed.h"

static const uint16_t LINE_ROOM = PAYLOAD;
static const uint16_t MOST_WATCHDOG = 400;
static uint16_t payload_at = 0, payload_size = 0, payload_out = 0;

static inline void line_begin() {
  uint8_t record[PAIR_RECORD];
  chip_line_begin(PAIR_BAUD);
  if (!chip_kept(record, sizeof record)) return; /* nobody is paired: no Wi-Fi */
  begin_seals(record);
  chip_wifi_begin((const char *)record + PAIR_NETWORK, (const char *)record + PAIR_PASSWORD, DERMIS_UDP_PORT);
}

/* One datagram a loop at most, and not before the last one has been read. `held`: it is armed for the session in force;
   `moving`: pulses go out, so nothing may be written into flash. */
static inline void serve_line(bool held, bool moving) {
  serve_pairing(moving);
  if (payload_at < payload_size) return;
  ChipPeer from;
  uint16_t size = chip_udp_receive(from, datagram, sizeof datagram);
  payload_at = 0;
  payload_size = size ? take_datagram(from, size, held) : 0;
}

static inline uint16_t line_waiting() { return (uint16_t)(payload_size - payload_at); }
static inline uint8_t line_take() { return datagram[SEAL_HEAD + payload_at++]; }
static inline uint16_t line_room() { return opened ? (uint16_t)(PAYLOAD - payload_out) : 0; }
static inline void line_put(uint8_t byte) { answer[SEAL_HEAD + payload_out++] = byte; }
static inline void line_send() {
  seal_data(payload_out);
  payload_out = 0;
}
