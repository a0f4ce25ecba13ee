//! Time stamps: numbers, date-times of ISO 8601, and clock times, in s.
//!
//! ```text
//! number       12.34                              times the unit of the column
//! date-time    2026-11-23T20:34:19.250+01:00      s since the first stamp of the file; `/` and a blank for `-` and T
//! clock time   20:34:19.250                       s since the first stamp; a day is added after midnight
//! ```
//!
//! Trap: a date-time in s has too many digits for a double, so whole nanoseconds are subtracted first.

use super::number::Decimal;

/// Nanoseconds of a second.
const SECOND: i128 = 1_000_000_000;
/// Nanoseconds of a day.
const DAY: i128 = 86_400 * SECOND;
/// What a time stamp may be.
const ALLOWED: &str = "a number, a date-time such as 2026-01-31T10:20:30.125, or a clock time such as 10:20:30.125, in \
                       all rows";

/// How a column has its time stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    Number,
    DateTime,
    Clock,
}

/// Reads the time stamps of one file, one after the other.
#[derive(Debug, Clone, Default)]
pub(super) struct Stamps {
    form: Option<Form>,
    first: Option<i128>,
    last: i128,
    /// Midnights so far, as nanoseconds.
    days: i128,
}

impl Form {
    /// The form of a field, from the signs in it.
    pub(super) fn of(text: &str) -> Self {
        match text.split_once(':') {
            None => Self::Number,
            Some((before, _)) if before.contains(['-', '/']) => Self::DateTime,
            Some(_) => Self::Clock,
        }
    }

    /// Whether the stamps have a unit of their own.
    pub(super) fn has_unit(self) -> bool {
        self != Self::Number
    }
}

impl Stamps {
    /// The form of all stamps so far.
    pub(super) fn form(&self) -> Form {
        self.form.unwrap_or(Form::Number)
    }

    /// The time of a field: in the unit of the column for a number, else in s since the first stamp.
    pub(super) fn parse(&mut self, text: &str, decimal: &mut Decimal) -> Result<f64, (String, &'static str)> {
        let refused = || (format!("\"{text}\""), ALLOWED);
        let stamp = match *self.form.get_or_insert(Form::of(text)) {
            Form::Number if Form::of(text) == Form::Number => return decimal.parse(text),
            Form::Number => None,
            Form::DateTime => date_time(text),
            Form::Clock => clock(text).map(|stamp| {
                // A clock that runs back by half a day or more has passed midnight.
                if self.last - (stamp + self.days) >= DAY / 2 {
                    self.days += DAY;
                }
                stamp + self.days
            }),
        };
        let stamp = stamp.ok_or_else(refused)?;
        self.last = stamp;
        Ok((stamp - *self.first.get_or_insert(stamp)) as f64 / SECOND as f64)
    }
}

/// Nanoseconds since 1970 in UTC, or in the unknown zone of the text.
fn date_time(text: &str) -> Option<i128> {
    let (date, time) = text.split_once(['T', 't', ' '])?;
    let time = time.trim();
    let (time, zone) = match time.find(['Z', 'z', '+', '-']) {
        None => (time, 0),
        Some(place) => (&time[..place], zone(&time[place..])?),
    };
    let mut parts = date.trim().split(['-', '/']);
    let mut part = |digits: std::ops::RangeInclusive<usize>| whole(parts.next()?, digits);
    let (year, month, day) = (part(4..=4)?, part(1..=2)?, part(1..=2)?);
    if parts.next().is_some() {
        return None;
    }
    Some(days(year, month, day)? * DAY + clock(time.trim())? - zone)
}

/// Days since 1970 of a day of the Gregorian calendar, from the days of whole years, that begin in March.
fn days(year: i128, month: i128, day: i128) -> Option<i128> {
    let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let longest = match month {
        2 => 28 + i128::from(leap),
        4 | 6 | 9 | 11 => 30,
        1..=12 => 31,
        _ => return None,
    };
    if !(1..=longest).contains(&day) {
        return None;
    }
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let leap_days = year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400);
    Some(365 * year + leap_days + (153 * month + 2) / 5 + day - 1 - 719_468)
}

/// Nanoseconds since midnight of `H:MM`, `H:MM:SS` or `H:MM:SS.f`.
fn clock(text: &str) -> Option<i128> {
    let mut parts = text.split(':');
    let (hours, minutes) = (whole(parts.next()?, 1..=2)?, whole(parts.next()?, 2..=2)?);
    let seconds = parts.next().unwrap_or("00");
    let (seconds, fraction) = seconds.split_once(['.', ',']).unwrap_or((seconds, "0"));
    let seconds = whole(seconds, 2..=2)?;
    // A leap second is the second 60.
    if hours > 23 || minutes > 59 || seconds > 60 || parts.next().is_some() {
        return None;
    }
    // Digits beyond the nanosecond are left out.
    whole(fraction, 1..=usize::MAX)?;
    let nanoseconds = whole(&format!("{fraction:0<9}")[..9], 9..=9)?;
    Some((3600 * hours + 60 * minutes + seconds) * SECOND + nanoseconds)
}

/// Nanoseconds by which a zone is before UTC: `Z`, `+HH`, `+HHMM` or `+HH:MM`.
fn zone(text: &str) -> Option<i128> {
    let (sign, digits) = match text.as_bytes().first()? {
        b'+' => (1, &text[1..]),
        b'-' => (-1, &text[1..]),
        _ => return (text.len() == 1).then_some(0),
    };
    let digits = digits.replace(':', "");
    let hours = whole(digits.get(..2)?, 2..=2)?;
    let minutes = if digits.len() > 2 { whole(&digits[2..], 2..=2)? } else { 0 };
    (hours < 24 && minutes < 60).then_some(sign * (3600 * hours + 60 * minutes) * SECOND)
}

/// A number of so many digits and nothing else. The value of a longer number than 18 digits is not used.
fn whole(text: &str, digits: std::ops::RangeInclusive<usize>) -> Option<i128> {
    let only_digits = text.bytes().all(|byte| byte.is_ascii_digit()) && digits.contains(&text.len());
    only_digits.then(|| text.get(..text.len().min(18))?.parse().ok()).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times<const N: usize>(texts: [&str; N]) -> [f64; N] {
        let (mut stamps, mut decimal) = (Stamps::default(), Decimal::default());
        texts.map(|text| stamps.parse(text, &mut decimal).expect(text))
    }

    #[test]
    fn numbers_stay_and_other_stamps_count_from_the_first_one() {
        assert_eq!(times(["7.5", "8"]), [7.5, 8.0]);
        assert_eq!(times(["7,5", "8"]), [7.5, 8.0]);
        assert_eq!(times(["2026-11-23T20:34:19.250", "2026-11-23T20:34:19.260"]), [0.0, 0.01]);
        assert_eq!(times(["2026/11/23 9:34:19,25", "2026/11/23 10:34:19"]), [0.0, 3599.75]);
        assert_eq!(
            times(["2026-11-23T20:00Z", "2026-11-23T20:00+01:00", "2026-11-23T20:00-0230"]),
            [0.0, -3600.0, 9e3]
        );
        assert_eq!(times(["2024-02-28T00:00:00", "2024-03-01T00:00:00"]), [0.0, 172_800.0]);
        assert_eq!(times(["1999-12-31T23:59:59.999999999", "2000-01-01T00:00:00"]), [0.0, 1e-9]);
        assert_eq!(times(["23:59:59.99", "00:00:00.00", "00:00:00.0123456789"]), [0.0, 0.01, 0.022_345_678]);
        assert_eq!(times(["10:00:00", "9:59:59"]), [0.0, -1.0]);
        assert_eq!(days(1970, 1, 1), Some(0));
        assert_eq!(days(2000, 3, 1), Some(11_017));
    }

    #[test]
    fn what_is_no_time_is_refused() {
        for wrong in [
            "2026-02-29T10:00:00",
            "2026-13-01T10:00:00",
            "2026-00-01T10:00:00",
            "2026-11-23T24:00:00",
            "2026-11-23T20:61:00",
            "2026-11-23T20:00:00+1",
            "2026-11-23T20:00:00+é1",
            "23-11-2026 10:00:00",
            "10:00:00.",
            "10:00:00.x",
            "1:2:3",
            "10:00:00:00",
            "::",
            "-:",
        ] {
            assert!(Stamps::default().parse(wrong, &mut Decimal::default()).is_err(), "{wrong}");
        }
        let (mut stamps, mut decimal) = (Stamps::default(), Decimal::default());
        stamps.parse("1.5", &mut decimal).unwrap();
        assert!(stamps.parse("10:00:00", &mut decimal).is_err(), "another form than the row before");
    }
}
