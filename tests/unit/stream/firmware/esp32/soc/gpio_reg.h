#pragma once
#define REG_WRITE(_r, _v) (*(volatile uint32_t *)(uintptr_t)(_r) = (_v))
#define GPIO_OUT_W1TS_REG 0x60004008
#define GPIO_OUT_W1TC_REG 0x6000400c
