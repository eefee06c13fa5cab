//! Facts about the machine, the build and the moment of a run, for people: nothing of it reaches a result or a digest.

#![expect(clippy::disallowed_types, reason = "the date of a report is for people; no result depends on it")]

use crate::version;
use std::time::{SystemTime, UNIX_EPOCH};

/// Names and values, for the row under the title of a page.
pub(super) fn facts() -> Vec<(&'static str, String)> {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs());
    let shown = ["commit", "rustc", "processor", "threads"];
    let mut facts = vec![("date", date(now)), ("lastlight", version::VERSION.to_owned())];
    let build = version::facts().into_iter().filter(|(name, _)| shown.contains(name));
    facts.extend(build.map(|(name, value)| {
        let short = value.strip_prefix(name).map(|rest| rest.trim().to_owned());
        (name, short.unwrap_or(value))
    }));
    facts
}

/// Seconds since 1970 as `2026-11-23 17:40 UTC`.
fn date(seconds: u64) -> String {
    let (days, rest) = (seconds / 86_400, seconds % 86_400);
    // Days of the Gregorian calendar, counted from 1 March of the year 0 (Hinnant, chrono-compatible low-level date algorithms).
    let shifted = days + 719_468;
    let (era, day_of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted_month + 2) / 5 + 1;
    let month = if shifted_month < 10 { shifted_month + 3 } else { shifted_month - 9 };
    let year = era * 400 + year_of_era + u64::from(month <= 2);
    format!("{year}-{month:02}-{day:02} {:02}:{:02} UTC", rest / 3600, rest / 60 % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        assert_eq!(date(0), "1970-01-01 00:00 UTC", "the epoch");
        assert_eq!(date(951_782_399), "2000-02-28 23:59 UTC", "before a leap day");
        assert_eq!(date(951_782_400), "2000-02-29 00:00 UTC", "a leap day");
        assert_eq!(date(1_795_456_800), "2026-11-23 18:00 UTC", "a date of this century");
    }
}
