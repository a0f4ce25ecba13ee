//! One value within the bytes of a frame, as DBC files describe it.
//!
//! ```text
//! value = factor x raw + offset
//! START|BITS@ORDER SIGN (FACTOR,OFFSET)      0|16@1- (0.001,0)
//! ```
//!
//! Order 1 is little-endian (Intel): START is the lowest bit, and bits go up. Order 0 is big-endian (Motorola): START
//! is the highest bit; the next one is the bit below, and below bit 0 of a byte comes bit 7 of the next byte. Bit n of
//! a frame is bit n mod 8 of byte n / 8. Sign - is two's complement.
//!
//! Trap: the same START means another place in each of the two orders.

use crate::MAX_FD_DATA;

/// Bits of the longest frame.
const FRAME_BITS: u32 = 8 * MAX_FD_DATA as u32;

/// Where a value is within a frame, and what it means.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Signal {
    start: u16,
    bits: u8,
    is_big_endian: bool,
    is_signed: bool,
    factor: f64,
    offset: f64,
}

/// A signal that is none.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SignalError {
    /// The text is none of a signal.
    #[error("found \"{0}\"; allowed: START|BITS@ORDER SIGN (FACTOR,OFFSET), such as 0|16@1- (0.001,0)")]
    Notation(String),
    /// It has no bits or too many.
    #[error("found {0} bits; allowed: 1 to 64")]
    Bits(u64),
    /// It does not fit into its frame.
    #[error("found bits up to byte {byte}; allowed: a signal within the {length} bytes of its frame")]
    Outside {
        /// The last byte, from 0.
        byte: u32,
        /// Bytes of the frame.
        length: u8,
    },
    /// The factor is none.
    #[error("found the factor {0} and the offset {1}; allowed: numbers, and a factor that is not 0")]
    Factor(f64, f64),
}

impl Signal {
    /// A signal in a frame of `length` bytes.
    ///
    /// # Errors
    /// It has no bits or more than 64, or does not fit; the factor is 0 or no number.
    pub fn new(
        (start, bits): (u64, u64),
        (is_big_endian, is_signed): (bool, bool),
        (factor, offset): (f64, f64),
        length: u8,
    ) -> Result<Self, SignalError> {
        if !(1..=64).contains(&bits) {
            return Err(SignalError::Bits(bits));
        }
        if !factor.is_finite() || factor == 0.0 || !offset.is_finite() {
            return Err(SignalError::Factor(factor, offset));
        }
        let start = u16::try_from(start).unwrap_or(u16::MAX);
        let signal = Self { start, bits: bits as u8, is_big_endian, is_signed, factor, offset };
        let last = signal.places().max().unwrap_or_default();
        if last >= FRAME_BITS || last >= 8 * u32::from(length) {
            return Err(SignalError::Outside { byte: last / 8, length });
        }
        Ok(signal)
    }

    /// Reads the notation of a DBC file.
    ///
    /// # Errors
    /// The text is none, or as [`Self::new`].
    ///
    /// ```
    /// use can::frames::Signal;
    ///
    /// let signal = Signal::parse("8|16@1- (0.5,10)", 8)?;
    /// assert_eq!(signal.value(&[0, 0xFE, 0xFF]), Some(9.0));
    /// # Ok::<(), can::frames::SignalError>(())
    /// ```
    pub fn parse(text: &str, length: u8) -> Result<Self, SignalError> {
        let refuse = || SignalError::Notation(text.chars().take(60).collect());
        let parts = || {
            let (place, rest) = text.trim().split_once('@')?;
            let (start, bits) = place.split_once('|')?;
            let mut rest = rest.trim().chars();
            let is_big_endian = match rest.next()? {
                '0' => true,
                '1' => false,
                _ => return None,
            };
            let is_signed = match rest.next()? {
                '-' => true,
                '+' => false,
                _ => return None,
            };
            let scale = rest.as_str().trim();
            let (factor, offset) = match scale {
                "" => (1.0, 0.0),
                _ => {
                    let (factor, offset) = scale.strip_prefix('(')?.strip_suffix(')')?.split_once(',')?;
                    (factor.trim().parse().ok()?, offset.trim().parse().ok()?)
                }
            };
            let place = (start.trim().parse().ok()?, bits.trim().parse().ok()?);
            Some((place, (is_big_endian, is_signed), (factor, offset)))
        };
        let (place, kind, scale) = parts().ok_or_else(refuse)?;
        Self::new(place, kind, scale, length)
    }

    /// Places of its bits, from the lowest one (Intel) or the highest one (Motorola).
    fn places(self) -> impl Iterator<Item = u32> {
        let mut place = u32::from(self.start);
        (0..self.bits).map(move |i| {
            if i > 0 {
                place = match (self.is_big_endian, place % 8) {
                    (false, _) => place + 1,
                    (true, 0) => place + 15,
                    (true, _) => place - 1,
                };
            }
            place
        })
    }

    /// Whether both have a bit in common.
    pub fn overlaps(&self, other: &Self) -> bool {
        self.places().any(|place| other.places().any(|other| other == place))
    }

    /// A whole byte of a frame, from 0, as a number without a sign.
    pub fn byte(place: u8) -> Self {
        let start = 8 * u16::from(place);
        Self { start, bits: 8, is_big_endian: false, is_signed: false, factor: 1.0, offset: 0.0 }
    }

    /// The number in these bytes; `None` where they are too few.
    pub fn raw(&self, data: &[u8]) -> Option<i64> {
        let mut raw = 0_u64;
        for (i, place) in self.places().enumerate() {
            let bit = u64::from(data.get(place as usize / 8)? >> (place % 8) & 1);
            raw = if self.is_big_endian { raw << 1 | bit } else { raw | bit << i };
        }
        Some(if self.is_signed { crate::canopen::signed(raw, self.bits) } else { raw as i64 })
    }

    /// The value in these bytes; `None` where they are too few.
    pub fn value(&self, data: &[u8]) -> Option<f64> {
        let raw = self.raw(data)?;
        let number = if self.is_signed { raw as f64 } else { raw as u64 as f64 };
        Some(self.factor * number + self.offset)
    }

    /// Puts a number into these bytes; its lowest bits count.
    pub fn put_raw(&self, raw: i64, data: &mut [u8]) {
        for (i, place) in self.places().enumerate() {
            let shift = if self.is_big_endian { usize::from(self.bits) - 1 - i } else { i };
            let bit = (raw >> shift & 1) as u8;
            if let Some(byte) = data.get_mut(place as usize / 8) {
                *byte = *byte & !(1 << (place % 8)) | bit << (place % 8);
            }
        }
    }

    /// Puts a value into these bytes: the nearest number that the signal has. A value that is no number is 0.
    pub fn put(&self, value: f64, data: &mut [u8]) {
        let value = if value.is_finite() { value } else { 0.0 };
        let (least, greatest) = self.range();
        // Powers of two are exact, and a conversion to an integer stays within its range.
        let raw = ((value - self.offset) / self.factor).round().clamp(least, greatest);
        let raw = if self.is_signed { raw as i64 } else { raw as u64 as i64 };
        self.put_raw(raw, data);
    }

    /// Least and greatest number.
    pub fn range(&self) -> (f64, f64) {
        let all = 2_f64.powi(i32::from(self.bits));
        if self.is_signed { (-all / 2.0, all / 2.0 - 1.0) } else { (0.0, all - 1.0) }
    }

    /// Whether the signal can have this number.
    pub fn has(&self, number: f64) -> bool {
        let (least, greatest) = self.range();
        (least..=greatest).contains(&number)
    }

    /// Whether the value is one that the signal can say.
    pub fn is_exact(&self, value: f64) -> bool {
        let number = (value - self.offset) / self.factor;
        self.holds(value) && (number - number.round()).abs() < 1e-6
    }

    /// Whether the value is within what the signal can say.
    pub fn holds(&self, value: f64) -> bool {
        self.has(((value - self.offset) / self.factor).round())
    }

    /// Number of different numbers: the counter after the last one begins anew.
    pub fn modulus(&self) -> i64 {
        1_i64.checked_shl(u32::from(self.bits)).filter(|modulus| *modulus > 0).unwrap_or(i64::MAX)
    }

    /// Value of one count.
    pub fn factor(&self) -> f64 {
        self.factor
    }

    /// Value of the number 0.
    pub fn offset(&self) -> f64 {
        self.offset
    }

    /// Its bits.
    pub fn bits(&self) -> u8 {
        self.bits
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn both_orders_are_those_of_the_notation() {
        // The example of the DBC literature: 12 bits, highest one at bit 0, then down through bytes 1 and 2.
        let data = [0b0000_0001, 0b0000_0010, 0b1110_0000, 0, 0, 0, 0, 0];
        assert_eq!(Signal::parse("0|12@0+ (1,0)", 8).unwrap().raw(&data), Some(0b1000_0001_0111));
        assert_eq!(Signal::parse("7|16@0+ (1,0)", 2).unwrap().raw(&[0x12, 0x34]), Some(0x1234));
        assert_eq!(Signal::parse("0|16@1+ (1,0)", 2).unwrap().raw(&[0x12, 0x34]), Some(0x3412));
        assert_eq!(Signal::parse("4|8@1- (1,0)", 2).unwrap().raw(&[0xF0, 0x0F]), Some(-1));
        assert_eq!(Signal::parse("0|8@1+", 1).unwrap().value(&[200]), Some(200.0));
        assert_eq!(Signal::parse("8|8@1+", 2).unwrap().raw(&[1]), None);
    }

    #[test]
    fn values_are_bounded_to_what_the_signal_can_say() {
        let signal = Signal::parse("0|8@1- (0.5,1)", 8).unwrap();
        for (value, expected) in [(1.0, 0), (2.0, 2), (1e9, 127), (-1e9, 0x80), (f64::NAN, 0xFE)] {
            let mut data = [0xFF; 8];
            signal.put(value, &mut data);
            assert_eq!(data, [expected, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF], "{value}");
        }
        assert!(signal.holds(64.5) && !signal.holds(65.0));
    }

    #[test]
    fn signals_that_are_none_are_refused() {
        for (text, expected) in [
            ("", "found \"\"; allowed: START|BITS@ORDER"),
            ("0|8@2+ (1,0)", "allowed: START|BITS"),
            ("0|0@1+ (1,0)", "found 0 bits"),
            ("0|65@1+ (1,0)", "found 65 bits"),
            ("57|8@1+ (1,0)", "found bits up to byte 8; allowed: a signal within the 8 bytes"),
            ("999999|8@1+ (1,0)", "found bits up to byte"),
            ("56|9@0+ (1,0)", "found bits up to byte 8"),
            ("0|8@1+ (0,0)", "found the factor 0"),
            ("0|8@1+ (nan,0)", "found the factor NaN"),
        ] {
            let said = Signal::parse(text, 8).unwrap_err().to_string();
            assert!(said.contains(expected), "{text}: {said}");
        }
        assert!(Signal::parse("8|8@1+ (1,0)", 1).is_err());
    }

    proptest! {
        #[test]
        fn numbers_are_read_as_they_were_written(
            start in 0_u64..512, bits in 1_u64..=64, is_big_endian: bool, is_signed: bool, raw: i64, before: [u8; 64]
        ) {
            let kind = (is_big_endian, is_signed);
            let Ok(signal) = Signal::new((start, bits), kind, (1.0, 0.0), 64) else { return Ok(()) };
            let mut data = before;
            signal.put_raw(raw, &mut data);
            let mask = u64::MAX >> (64 - bits);
            let expected = raw as u64 & mask;
            prop_assert_eq!(signal.raw(&data).unwrap() as u64 & mask, expected);
            // Nothing else has changed.
            let mut again = data;
            signal.put_raw(signal.raw(&before).unwrap(), &mut again);
            prop_assert_eq!(again, before);
        }

        #[test]
        fn no_notation_is_too_strange(text in "\\PC{0,40}") {
            let _ = Signal::parse(&text, 8);
        }
    }
}
