/* The ATmega328P's serial port as its data sheet describes it, in place of simavr's (which holds 64 bytes that nobody
   has read, takes 11 bits a byte and sends with one register): two bytes wait in the receiver, a third in its shift
   register until the next start bit, then it is lost; the transmitter has a shift register and one byte before it. */
#include <simavr/sim_avr.h>
#include <stdint.h>

typedef struct {
  unsigned long overruns; /* bytes that came while two waited and a third was in the shift register */
  unsigned long garbled;  /* bytes that nobody could read: the chip's baud rate is another than the line's */
} usart_counts_t;

/* Put the model in place; `sent` is called when a byte has left the chip whole. */
void usart_begin(avr_t *avr, void (*sent)(uint8_t value));

/* Set the line's pace, both ways [bits a second]. */
void usart_baud(double baud);

/* Let bytes come down the line, one after the other without a pause, behind those that are still on their way. */
void usart_line(const uint8_t *bytes, unsigned count);

usart_counts_t usart_counts(void);
