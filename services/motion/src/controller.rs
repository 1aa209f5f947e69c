//! Links to real and simulated UR controllers.

use tokio::sync::watch;
use ur_link::{Controller, Error, Options};

use crate::arm::Connect;

/// Connects to one controller, again and again, and tells its name and version.
pub struct UrController {
    options: Options,
    version: watch::Sender<String>,
}

impl UrController {
    /// For a controller; the receiver holds its name and version once a link was made.
    pub fn new(options: Options) -> (Self, watch::Receiver<String>) {
        let (version, known) = watch::channel(String::new());
        (Self { options, version }, known)
    }
}

impl Connect for UrController {
    type Link = Controller;

    async fn connect(&mut self) -> Result<Controller, Error> {
        let controller = Controller::connect(self.options.clone()).await?;
        self.version.send_replace(controller.identity().to_string());
        Ok(controller)
    }
}
