// CRC-16/MCRF4XX, byte by byte, without a table: 2^16-1 at first, 0 after data and their own CRC.
#pragma once

#include <stdint.h>

#define CRC16_START 0xFFFFu

#ifdef __AVR__
#include <util/crc16.h> // the same in fifteen instructions

static inline uint16_t crc16(uint16_t crc, uint8_t byte) { return _crc_ccitt_update(crc, byte); }
#else
static inline uint16_t crc16(uint16_t crc, uint8_t byte)
{
    byte = (uint8_t)(byte ^ (crc & 0xFFu));
    byte = (uint8_t)(byte ^ (byte << 4));
    return (uint16_t)((((uint16_t)byte << 8) | (crc >> 8)) ^ (byte >> 4) ^ ((uint16_t)byte << 3));
}
#endif
