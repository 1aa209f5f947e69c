//! Days and moments as people write them, in UTC. The proleptic Gregorian calendar by the day counts of a 400-year era.

const DAY_MS: i64 = 86_400_000;
/// Days from 0000-03-01 to 1970-01-01.
const EPOCH_DAY: i64 = 719_468;
/// Days of 400 years.
const ERA_DAYS: i64 = 146_097;

/// The last millisecond of a day written as `YYYY-MM-DD`; `None` if there is no such day.
pub fn end_of_day_ms(day: &str) -> Option<i64> {
    let mut parts = day.split('-');
    let mut part = |digits: usize| -> Option<i64> {
        let text = parts.next()?;
        let is_number = text.len() == digits && text.bytes().all(|byte| byte.is_ascii_digit());
        is_number.then(|| text.parse().ok()).flatten()
    };
    let (year, month, day) = (part(4)?, part(2)?, part(2)?);
    let days = days_since_epoch(year, month, day);
    let exists = parts.next().is_none() && date_of(days) == (year, month, day);
    exists.then_some((days + 1) * DAY_MS - 1)
}

/// A moment as `YYYY-MM-DDTHH:MM:SSZ`.
pub fn utc(moment_ms: i64) -> String {
    let (year, month, day) = date_of(moment_ms.div_euclid(DAY_MS));
    let second = moment_ms.rem_euclid(DAY_MS) / 1000;
    let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// Years begin in March here, so that the leap day is their last.
fn days_since_epoch(year: i64, month: i64, day: i64) -> i64 {
    let year = if month <= 2 { year - 1 } else { year };
    let year_of_era = year.rem_euclid(400);
    let day_of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    let day_of_era = year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year;
    year.div_euclid(400) * ERA_DAYS + day_of_era - EPOCH_DAY
}

/// Year, month, day.
fn date_of(days_since_epoch: i64) -> (i64, i64, i64) {
    let days = days_since_epoch + EPOCH_DAY;
    let day_of_era = days.rem_euclid(ERA_DAYS);
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = (month_from_march + 2) % 12 + 1;
    let year = year_of_era + days.div_euclid(ERA_DAYS) * 400;
    (if month <= 2 { year + 1 } else { year }, month, day)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_day_holds_until_its_last_millisecond() {
        assert_eq!(end_of_day_ms("1970-01-01"), Some(DAY_MS - 1));
        assert_eq!(end_of_day_ms("2024-02-29"), Some(1_709_251_199_999));
        assert_eq!(utc(1_709_251_199_999), "2024-02-29T23:59:59Z");
    }

    #[test]
    fn what_is_no_day_is_none() {
        for text in [
            "2023-02-29",
            "2024-13-01",
            "2024-1-1",
            "2024-04-31",
            "2024-04-01-01",
            "+024-04-01",
            "",
        ] {
            assert_eq!(end_of_day_ms(text), None, "{text}");
        }
    }

    proptest! {
        #[test]
        fn a_moment_lies_in_the_day_that_it_is_written_with(moment_ms in 0..4_000_000_000_000i64) {
            let text = utc(moment_ms);
            let end_ms = end_of_day_ms(&text[..10]).unwrap();
            prop_assert!((end_ms - DAY_MS + 1..=end_ms).contains(&moment_ms));
        }
    }
}
