/* Blender Servo Animation: 0x3C, id, position high, position low, 0x3E; every 0x3C starts anew, as in the original. */
#pragma once
#include "last_resort.h"
#include "pulses.h"

#ifdef DERMIS_WIFI
#error "DERMIS_WIFI works with the native protocol only: this one has neither check sum nor watchdog."
#endif
#ifdef DERMIS_RELAY_PIN
#error "DERMIS_RELAY_PIN works with the native protocol only: nothing tells this one when to switch the supply on."
#endif

static const uint8_t BYTES_A_LOOP = 16; /* whatever comes in, the silence is looked at */
static const uint16_t SILENCE_MS = 500;

static uint8_t command[5], filled = 0;
static uint32_t heard = 0;

void setup() {
  begin_pulses();
  chip_line_begin(115200);
  begin_watchdog();
}

static void take_byte(uint8_t byte) {
  if (byte == 0x3C) filled = 0;
  if (filled == 5) return; /* nothing more before the next start */
  command[filled++] = byte;
  if (filled < 5 || command[0] != 0x3C || command[4] != 0x3E) return;
  uint16_t us = (uint16_t)(command[2] << 8 | command[3]);
  if (command[1] >= CHANNELS || us < SHORTEST_US || us > LONGEST_US) return;
  set_pulse(command[1], (ChipTicks)(us * CHIP_TICKS_A_US), 0);
  pulsing = true;
  heard = chip_ms();
}

/* The original has no watchdog; here servos let go, and each begins anew with its own next command: nobody asked for
   where it was before. */
static void let_go() {
  pulsing = false;
  for (uint8_t c = 0; c < CHANNELS; c++) set_pulse(c, 0, 0);
}

void loop() {
  for (uint8_t n = 0; n < BYTES_A_LOOP && chip_line_waiting(); n++) take_byte(chip_line_take());
  serve_pulses();
  if (pulsing && chip_ms() - heard > SILENCE_MS) let_go();
  alive();
}
