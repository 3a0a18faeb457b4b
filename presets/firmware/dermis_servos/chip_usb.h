/* The line to the computer over the chip's own USB, by the Arduino core's Serial: for chips that have no USB adapter
   between. The rate of the port means nothing there. */
#pragma once
#include <Arduino.h>
#include <stdint.h>

static const uint16_t CHIP_LINE_ROOM = 256;
static uint8_t usb_out[CHIP_LINE_ROOM];
static uint16_t usb_held = 0;

constexpr bool chip_line_baud(uint32_t baud) { return baud > 0; }

static inline uint16_t chip_line_waiting() {
  int waiting = Serial.available();
  return waiting > 0 ? (uint16_t)waiting : 0;
}

static inline uint8_t chip_line_take() { return (uint8_t)Serial.read(); }

/* What USB has no room for never gets here, so that nothing waits for a computer that does not read. */
static inline uint16_t chip_line_room() {
  int room = Serial.availableForWrite() - (int)usb_held;
  int most = (int)CHIP_LINE_ROOM - (int)usb_held;
  return room <= 0 ? 0 : (uint16_t)(room < most ? room : most);
}

static inline void chip_line_put(uint8_t byte) { usb_out[usb_held++] = byte; }

static inline void chip_line_send() {
  Serial.write(usb_out, usb_held);
  usb_held = 0;
}
