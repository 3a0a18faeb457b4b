/* PCA9685 boards on an I2C bus, by NXP's data sheet (rev. 4): registers, cycle, and pulses while OE is low. */
#pragma once
#include <stdint.h>

#define PCA_NEVER UINT64_MAX

/* Set how many boards answer, from address 0x40 on, and their oscillator [Hz]. */
void pca_boards(unsigned count);
void pca_clock(double hz);

/* A write that ended at a time [ps]; return whether it was acknowledged. */
int pca_write(uint64_t now, uint8_t address, const uint8_t *bytes, unsigned size);

/* Set OE's level. */
void pca_oe(uint64_t now, int level);

/* When something happens next, and let it happen; `ended` is called with channel, start and end of each pulse. */
uint64_t pca_next(void);
void pca_pass(uint64_t now, void (*ended)(unsigned channel, uint64_t start, uint64_t end));

/* Return a register of a board. */
uint8_t pca_register(unsigned board, uint8_t at);
