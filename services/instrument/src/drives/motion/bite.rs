//! Closing the jaw, with the current limited and the lag not: tissue may hold the jaw anywhere on its way.

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
    link.begin_profile(profile).await?;
    watch.begin(link.ask().await?.stamp);
    loop {
        if let Some(ended) = watch.observe(&link.sample().await?) {
            return Ok(ended?);
        }
    }
}
