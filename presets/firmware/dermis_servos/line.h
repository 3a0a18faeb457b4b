/* The line to the sender: the chip's own, or datagrams over Wi-Fi. Either header provides
     LINE_ROOM, MOST_WATCHDOG     bytes that an answer may have; the longest silence that a sender may ask for [ms]
     line_begin, serve_line       opens it; in each loop: takes what has come, `held`: nobody else may take it over
     line_waiting, line_take      bytes that have come in, and the next of them
     line_room, line_put          room for bytes that go out, and one more of them; line_send lets them go */
#pragma once
#include "chip.h"
#ifdef DERMIS_WIFI
#include "line_wifi.h"
#else
static const uint16_t LINE_ROOM = CHIP_LINE_ROOM;
static const uint16_t MOST_WATCHDOG = 80;
static inline void line_begin() { chip_line_begin(DERMIS_BAUD); }
static inline void serve_line(bool, bool) {}
static inline uint16_t line_waiting() { return chip_line_waiting(); }
static inline uint8_t line_take() { return chip_line_take(); }
static inline uint16_t line_room() { return chip_line_room(); }
static inline void line_put(uint8_t byte) { chip_line_put(byte); }
static inline void line_send() { chip_line_send(); }
#endif
