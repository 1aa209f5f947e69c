//! Closing the jaw, with the current limited and the lag not: tissue may hold the jaw anywhere on its way.

use epos4_link::objects;

use super::referenced;
use crate::bite::{BiteEnd, Watch};
use crate::drives::link::{Link, Profile};
use crate::error::Failure;

/// The drive keeps closing with the current of the bite after the end, so that the jaw does not lose what it holds.
pub(super) async fn bite(link: &Link, current_limit_ma: f64) -> Result<BiteEnd, Failure> {
    let bite = &link.cell().bite;
    let open = referenced(link).await?;
    let mut watch = Watch::new(bite.clone(), current_limit_ma, link.spec().tolerance, &open)?;
    let profile = Profile {
        target: bite.target_mm(),
        speed: bite.contact.speed_mm_s,
        current_limit_ma,
        following_error: link.spec().travel.span(),
    };
    let mut seen = link.begin_profile(profile).await?.started();
    watch.begin(seen);
    let mut presses = false;
    loop {
        let sample = link.sample().await?;
        for (position_mm, current_ma, stamp) in link.passed(seen, sample.stamp) {
            watch.pass(position_mm, current_ma, stamp);
        }
        seen = seen.max(sample.stamp);
        match watch.observe(&sample) {
            None if watch.presses() && !presses => {
                watch.press(link.change_speed(bite.press.speed_mm_s).await?);
                presses = true;
            }
            None => {}
            Some(Ok(end)) => return Ok(end),
            Some(Err(error)) => {
                press_no_more(link).await;
                return Err(error.into());
            }
        }
    }
}

/// Behind an encoder that stands still, the drive would go on pressing with the whole current, also in quick stop. The
/// screw holds the jaw without any.
async fn press_no_more(link: &Link) {
    let limit_ma = link.cell().bite.contact.current_ma.round() as u32;
    let limit = objects::OUTPUT_CURRENT_LIMIT;
    if let Err(error) = link.node().write_urgently(limit, limit_ma).await {
        tracing::error!(axis = %link.axis(), %error, "the current of a bite that failed is not taken back");
    }
}
