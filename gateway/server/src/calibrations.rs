//! The cell's calibrations: kept as records with covariance and expiry, and put in force by people.
//!
//! [`Calibrations`] is a handle that clones cheaply. It knows the configured cell and which saved calibrations stand in the
//! place of configured ones; [`Calibrations::refresh`] reads that anew, and whoever decides anything asks for it first.

pub mod record;

use std::sync::{Arc, PoisonError, RwLock};

use uuid::Uuid;

use crate::approval;
use crate::calibrations::record::{Calibration, InForce, Kind, Measured, Revocation};
use crate::config::{Cell, Validity};
use crate::error::{Error, Result};
use crate::journal::Journal;
use crate::wall_clock::now_ms;

const DAY_MS: f64 = 86_400_000.0;

/// The calibrations of this gateway's cell.
#[derive(Clone)]
pub struct Calibrations(Arc<Shared>);

struct Shared {
    journal: Arc<dyn Journal>,
    validity: Validity,
    configured: Option<Arc<Cell>>,
    /// The configured cell with the saved calibrations in force, as last read.
    cell: RwLock<Option<Arc<Cell>>>,
    /// Held from reading a calibration to writing it back.
    changing: tokio::sync::Mutex<()>,
}

/// What a person saves.
#[derive(Clone, Debug)]
pub struct New {
    /// For people to read.
    pub label: String,
    /// Who saves.
    pub saved_by: String,
    /// How long it holds, s; `None`: as long as the configuration says.
    pub valid_for_s: Option<f64>,
    /// What was measured.
    pub measured: Measured,
    /// The whole result as it came.
    pub encoded: bytes::Bytes,
}

/// A calibration and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub enum Listed {
    /// The one of this kind in the configuration, and whether it is in force.
    Configured(Kind, bool),
    /// A saved one, and whether it is in force.
    Saved(Box<Calibration>, bool),
}

impl Calibrations {
    /// Calibrations of a journal beside those of the configuration; `configured` is `None` in a cell without any.
    pub async fn open(
        journal: Arc<dyn Journal>,
        configured: Option<Cell>,
        validity: Validity,
    ) -> Result<Self> {
        let configured = configured.map(Arc::new);
        let this = Self(Arc::new(Shared {
            journal,
            validity,
            cell: RwLock::new(configured.clone()),
            configured,
            changing: tokio::sync::Mutex::default(),
        }));
        this.refresh().await?;
        Ok(this)
    }

    /// Where things are in the cell, as last read.
    pub fn cell(&self) -> Option<Arc<Cell>> {
        let cell = self.0.cell.read().unwrap_or_else(PoisonError::into_inner);
        cell.clone()
    }

    /// Where things are in the cell, configured and without any saved calibration.
    pub fn configured(&self) -> Option<&Cell> {
        self.0.configured.as_deref()
    }

    /// Reads anew what is in force: another gateway of the same journal may have changed it.
    pub async fn refresh(&self) -> Result<Option<Arc<Cell>>> {
        let Some(configured) = &self.0.configured else {
            return Ok(None);
        };
        let mut cell = Cell::clone(configured);
        for calibration in self.0.journal.calibrations_in_force().await? {
            put_in(&mut cell, &calibration);
        }
        let cell = Some(Arc::new(cell));
        let mut known = self.0.cell.write().unwrap_or_else(PoisonError::into_inner);
        known.clone_from(&cell);
        Ok(cell)
    }

    /// Keeps a calibration; it is not in force yet.
    pub async fn save(&self, new: New) -> Result<Listed> {
        let saved_at_ms = now_ms();
        let default_days = match new.measured {
            Measured::HandEye { .. } => self.0.validity.hand_eye_days,
            Measured::ToolTip { .. } => self.0.validity.tool_tip_days,
        };
        let valid_for_ms = new
            .valid_for_s
            .map_or(default_days * DAY_MS, |seconds| seconds * 1000.0);
        let calibration = Calibration {
            id: Uuid::now_v7().to_string(),
            label: new.label,
            saved_by: new.saved_by,
            saved_at_ms,
            valid_until_ms: saved_at_ms.saturating_add(valid_for_ms as i64),
            measured: new.measured,
            encoded: new.encoded,
            revoked: None,
        };
        self.0.journal.create_calibration(&calibration).await?;
        tracing::info!(calibration_id = calibration.id, kind = %calibration.kind(), "calibration saved");
        Ok(Listed::Saved(Box::new(calibration), false))
    }

    /// The configured ones, then the newest first.
    pub async fn list(&self) -> Result<Vec<Listed>> {
        self.refresh().await?;
        let configured = Kind::ALL
            .iter()
            .map(|kind| Listed::Configured(*kind, self.is_in_force(*kind, kind.configured_id())));
        let mut listed: Vec<_> = configured.filter(|_| self.0.configured.is_some()).collect();
        for calibration in self.0.journal.calibrations().await? {
            listed.push(self.listed(calibration));
        }
        Ok(listed)
    }

    /// One of them.
    pub async fn get(&self, calibration_id: &str) -> Result<Listed> {
        self.refresh().await?;
        if let Some(kind) = Kind::of_configured(calibration_id) {
            self.0.configured.as_ref().ok_or(Error::NotCalibrated)?;
            return Ok(Listed::Configured(
                kind,
                self.is_in_force(kind, calibration_id),
            ));
        }
        Ok(self.listed(self.saved(calibration_id).await?))
    }

    /// Puts one in force in the place of the one of its kind.
    pub async fn activate(&self, calibration_id: &str, operator: &str) -> Result<Listed> {
        self.0.configured.as_ref().ok_or(Error::NotCalibrated)?;
        let _changing = self.0.changing.lock().await;
        let journal = &self.0.journal;
        if let Some(kind) = Kind::of_configured(calibration_id) {
            journal.put_in_force(kind, None, operator, now_ms()).await?;
        } else {
            let calibration = self.saved(calibration_id).await?;
            calibration.usable(now_ms())?;
            let kind = calibration.kind();
            journal
                .put_in_force(kind, Some(calibration_id), operator, now_ms())
                .await?;
        }
        tracing::info!(calibration_id, operator, "calibration put in force");
        self.get(calibration_id).await
    }

    /// Says that one is not to be used any more.
    pub async fn revoke(
        &self,
        calibration_id: &str,
        operator: String,
        because: String,
    ) -> Result<Listed> {
        let _changing = self.0.changing.lock().await;
        let mut calibration = self.saved(calibration_id).await?;
        // The first revocation is the one that counts.
        if calibration.revoked.is_none() {
            let revocation = Revocation {
                by: operator,
                at_ms: now_ms(),
                because,
            };
            self.0
                .journal
                .revoke_calibration(calibration_id, &revocation)
                .await?;
            calibration.revoked = Some(revocation);
            tracing::warn!(calibration_id, "calibration revoked");
        }
        self.refresh().await?;
        Ok(self.listed(calibration))
    }

    /// A saved one.
    pub async fn saved(&self, calibration_id: &str) -> Result<Calibration> {
        let found = self.0.journal.calibration(calibration_id).await?;
        found.ok_or_else(|| Error::UnknownCalibration(calibration_id.to_owned()))
    }

    fn listed(&self, calibration: Calibration) -> Listed {
        let in_force = self.is_in_force(calibration.kind(), &calibration.id);
        Listed::Saved(Box::new(calibration), in_force)
    }

    fn is_in_force(&self, kind: Kind, id: &str) -> bool {
        self.cell().is_some_and(|cell| {
            let in_force: &InForce = &cell.calibrations;
            match kind {
                Kind::HandEye => in_force.hand_eye.id == id,
                Kind::ToolTip => in_force.tool_tip.id == id,
            }
        })
    }
}

fn put_in(cell: &mut Cell, calibration: &Calibration) {
    let digest = approval::calibration_digest(calibration);
    match &calibration.measured {
        Measured::HandEye { pose, covariance } => {
            cell.forceps_base_from_camera = *pose;
            cell.calibrations.hand_eye = calibration.standing(digest, *covariance);
        }
        Measured::ToolTip {
            covariance_mm2,
            flange_from_tool,
            ..
        } => {
            cell.calibrations.tool_tip = calibration.standing(digest, *covariance_mm2);
            if let Some(rotation) = flange_from_tool {
                cell.calibrations.flange_from_tool = *rotation;
            }
        }
    }
}
