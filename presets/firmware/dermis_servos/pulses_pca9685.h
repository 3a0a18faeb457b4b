/* Pulses for servos on PCA9685 boards: 16 a board, several boards on one I2C bus. The chips make the pulses; every round
   writes the newest values into their registers.

   Registers and times are those of NXP's data sheet (PCA9685, rev. 4). A chip takes new values at the end of its cycle, and
   a round is longer than a cycle, so no pulse is two rounds away from the one before.

   The boards' OE pin is the safe state: while it is high no pulse leaves them. It goes low when a whole round has been
   written after ARM, and high when the servos are let go, when a board does not acknowledge, and, by a resistor to the
   boards' VCC, when this chip is reset. */
#pragma once
#include "chip.h"
#include <stdint.h>

#ifndef DERMIS_OE_PIN
#define DERMIS_OE_PIN 12
#endif
#ifndef DERMIS_PCA9685_HZ
#define DERMIS_PCA9685_HZ 25000000 /* its oscillator: measure a pulse, and write 25000000 * (pulse wanted / pulse measured) */
#endif

#ifndef CHIP_I2C
#error "DERMIS_PCA9685: the header of this chip has no I2C, see chip.h"
#endif
static_assert(DERMIS_PCA9685 >= 1 && DERMIS_PCA9685 <= 62, "DERMIS_PCA9685: the number of boards, 1 to 62");
static_assert(DERMIS_CHANNELS >= 1, "DERMIS_CHANNELS: a board has one channel at least");
static_assert(DERMIS_CHANNELS <= 16 * DERMIS_PCA9685, "DERMIS_CHANNELS: so many PCA9685 boards have fewer channels");
static_assert(chip_relay_pin(DERMIS_OE_PIN), "DERMIS_OE_PIN: this pin cannot be the boards' OE, README.md says which can");
#ifdef DERMIS_RELAY_PIN
static_assert(DERMIS_RELAY_PIN != DERMIS_OE_PIN, "DERMIS_RELAY_PIN: this pin is the boards' OE, choose another");
#endif

static const uint8_t CHANNELS = DERMIS_CHANNELS;
static const uint8_t BOARDS = DERMIS_PCA9685;
static const uint8_t A_BOARD = 16;
static const uint8_t FIRST_ADDRESS = 0x40; /* its address bridges count up from here */
static const uint8_t ROUND_MS = 22; /* a cycle of 20 ms, and what the oscillator may be slower */
static const uint8_t ROUND_HZ = 1000 / ROUND_MS;
static const uint16_t SHORTEST_US = 1000;
static const uint16_t LONGEST_US = 2000;
static const uint32_t SHORTEST = (uint32_t)SHORTEST_US * CHIP_TICKS_A_US; /* ticks */
static const uint32_t LONGEST = (uint32_t)LONGEST_US * CHIP_TICKS_A_US;

enum PcaRegister : uint8_t { PCA_MODE1 = 0x00, PCA_MODE2 = 0x01, PCA_LED0 = 0x06, PCA_ALL_OFF_HIGH = 0xFD, PCA_PRESCALE = 0xFE };
static const uint8_t PCA_SLEEP = 0x10, PCA_INCREMENT = 0x20; /* of MODE1 */
static const uint8_t PCA_TOTEM_POLE = 0x04;                  /* of MODE2; outputs are low while OE is high */
static const uint8_t PCA_FULL_OFF = 0x10;                    /* of OFF_HIGH */

static const uint32_t CYCLES_HZ = 50;
static const uint8_t PRESCALE = (uint8_t)((DERMIS_PCA9685_HZ + 2048ul * CYCLES_HZ) / (4096ul * CYCLES_HZ) - 1);
/* Counts of 4096 in a tick, times 65536: a count takes PRESCALE + 1 of the oscillator's periods. */
static const uint32_t PACE = (uint32_t)(65536.0 * (DERMIS_PCA9685_HZ / 1e6) / (PRESCALE + 1.0) / CHIP_TICKS_A_US + 0.5);
static_assert(PACE < 0xFFFFFFFFu / LONGEST, "CHIP_TICKS_A_US: so many ticks a pulse do not fit into 32 bits");

static volatile ChipTicks ticks[CHANNELS]; /* of the next pulse, 0: this channel has none ... */
static volatile uint16_t counts[CHANNELS]; /* ... and the count that it stands for */
static volatile uint16_t pulsed[CHANNELS]; /* count that was written last */
static volatile bool pulsing = false;
static bool pulses_ready = false; /* every board acknowledges */
static uint8_t slots = 0;         /* rounds, counted, so that others can see them go on */

static uint8_t pca_bytes[1 + 4 * A_BOARD];
static uint16_t pca_counts[A_BOARD]; /* that pca_bytes stand for */
static uint8_t pca_board = 0, pca_step = 0;
static bool pca_sent = false, pca_whole = false, pca_open = false; /* pca_whole: this round began while pulsing */
static uint32_t pca_since = 0, pca_round = 0;

static void pca_enable(bool on) {
  if (on == pca_open) return;
  pca_open = on;
  chip_relay(DERMIS_OE_PIN, !on);
}

static inline void set_pulse(uint8_t channel, ChipTicks value, uint16_t count) {
  ticks[channel] = value;
  counts[channel] = count;
}

static inline uint16_t last_pulse(uint8_t channel) { return pulsed[channel]; }

static inline void begin_pulses() {
  chip_relay_begin(DERMIS_OE_PIN, true);
  for (uint8_t c = 0; c < CHANNELS; c++) ticks[c] = 0;
  chip_i2c_begin();
  pca_since = pca_round = chip_ms();
}

/* The steps of each board: asleep, so that its cycle may be set; cycle; outputs; all off; awake; then its pulses. */
static const uint8_t PCA_STEPS = 5;

static uint8_t pca_fill() {
  static const uint8_t first[PCA_STEPS][2] = {{PCA_MODE1, PCA_SLEEP | PCA_INCREMENT},
                                              {PCA_PRESCALE, PRESCALE},
                                              {PCA_MODE2, PCA_TOTEM_POLE},
                                              {PCA_ALL_OFF_HIGH, PCA_FULL_OFF},
                                              {PCA_MODE1, PCA_INCREMENT}};
  if (pca_step < PCA_STEPS) {
    pca_bytes[0] = first[pca_step][0];
    pca_bytes[1] = first[pca_step][1];
    return 2;
  }
  uint8_t size = 0;
  pca_bytes[size++] = PCA_LED0;
  for (uint8_t k = 0; k < A_BOARD && A_BOARD * pca_board + k < CHANNELS; k++) {
    uint8_t c = (uint8_t)(A_BOARD * pca_board + k);
    uint16_t off = (uint16_t)(((uint32_t)ticks[c] * PACE + 32768u) >> 16);
    bool on = pulsing && ticks[c];
    pca_counts[k] = counts[c];
    pca_bytes[size++] = 0;
    pca_bytes[size++] = 0;
    pca_bytes[size++] = on ? (uint8_t)off : 0;
    pca_bytes[size++] = on ? (uint8_t)(off >> 8) : PCA_FULL_OFF;
  }
  return size;
}

/* Without pulses, which is safe, the loop goes on and tells the sender. */
static void pca_failed() {
  pca_enable(false);
  slots = (uint8_t)(slots + 1);
  pulses_ready = pca_sent = false;
  pca_board = pca_step = 0;
  pca_round = chip_ms();
}

static void pca_written() {
  if (pca_step == PCA_STEPS) {
    for (uint8_t k = 0; k < A_BOARD && A_BOARD * pca_board + k < CHANNELS; k++) {
      if (pulsing) pulsed[A_BOARD * pca_board + k] = pca_counts[k];
    }
  } else if (++pca_step < PCA_STEPS) {
    return;
  }
  if (!pulses_ready && pca_step == PCA_STEPS && pca_board + 1 < BOARDS) {
    pca_step = 0; /* the next board begins from its start */
    pca_board++;
    return;
  }
  if (++pca_board < BOARDS) return;
  if (pulses_ready && pca_whole && pulsing) pca_enable(true);
  pulses_ready = true;
  pca_board = 0;
  slots = (uint8_t)(slots + 1);
}

/* Call it in each loop: it begins what is due and never waits. */
static void serve_pulses() {
  uint32_t now = chip_ms();
  if (!pulsing) pca_enable(false);
  if (pca_sent) {
    if (chip_i2c_busy()) {
      if (now - pca_since < ROUND_MS) return;
      chip_i2c_begin(); /* the bus is stuck */
      pca_failed();
      return;
    }
    pca_sent = false;
    if (!chip_i2c_acknowledged()) {
      pca_failed();
      return;
    }
    pca_written();
  }
  if (pulses_ready && pca_board == 0) {
    if (now - pca_round < ROUND_MS) return;
    pca_round += ROUND_MS;
    if (now - pca_round >= ROUND_MS) pca_round = now; /* what a stall has left out stays out */
    pca_whole = pulsing;
  } else if (!pulses_ready && pca_step == 0 && now - pca_round < ROUND_MS) {
    return; /* after a failure it tries again once a round */
  }
  pca_since = now;
  pca_sent = true;
  chip_i2c_send((uint8_t)(FIRST_ADDRESS + pca_board), pca_bytes, pca_fill());
}
