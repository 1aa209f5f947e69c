//! Cases: from two uploads to an approved plan, every change kept at once.
//!
//! [`Cases`] is a handle that clones cheaply. A change reads the case, applies the rule of
//! [`case::Case`], and writes it back under one lock. What is computed elsewhere for minutes is kept
//! only if the case is still what it was computed for.

pub mod case;
pub mod surface;
pub mod upload;

use std::sync::Arc;

use bytes::Bytes;
use tokio::sync::Mutex;
use uuid::Uuid;

use crate::approval::{self, Digest, Policy, Signatory};
use crate::aside::aside;
use crate::audit::{Audit, Entry, Kind, Who};
use crate::calibrations::Calibrations;
use crate::cases::case::{Acceptance, Case, ModelInfo, Plan, Registration, SceneInfo, Stage};
use crate::clients::planning::PackedModel;
use crate::config::Cell;
use crate::error::{Error, Result};
use crate::journal::{Blob, Journal, Page};
use crate::verification::{Finding, Limits, TOUCHES_MAX, Touch, Verdict, Verification};
use crate::wall_clock::now_ms;

/// The cases of this gateway.
#[derive(Clone)]
pub struct Cases {
    journal: Arc<dyn Journal>,
    calibrations: Calibrations,
    verification: Limits,
    policy: Policy,
    audit: Audit,
    /// Held from reading a case to writing it back.
    changing: Arc<Mutex<()>>,
}

/// A scene that passed its checks.
#[derive(Clone, Debug)]
pub struct Scene {
    /// How many points.
    pub point_count: u32,
    /// Whether each carries a unit normal.
    pub has_normals: bool,
    /// Packed points.
    pub points: Bytes,
}

/// What may be executed: a plan that is approved as it stands.
#[derive(Clone, Debug)]
pub struct Approved {
    /// The plan in ct.
    pub plan: Plan,
    /// Where ct lies in the view.
    pub registration: Registration,
    /// Where the view lies in the cell.
    pub cell: Arc<Cell>,
}

impl Cases {
    /// Cases of a journal, in a cell that may not be calibrated yet; touched landmarks are held to `verification`, approvals
    /// to `policy`.
    pub fn new(
        journal: Arc<dyn Journal>,
        calibrations: Calibrations,
        verification: Limits,
        policy: Policy,
        audit: Audit,
    ) -> Self {
        Self {
            journal,
            calibrations,
            verification,
            policy,
            audit,
            changing: Arc::default(),
        }
    }

    /// Opens a case.
    pub async fn create(&self, label: String) -> Result<Case> {
        let case = Case::new(Uuid::now_v7().to_string(), label, now_ms());
        self.journal.create_case(&case).await?;
        tracing::info!(case_id = case.id, "case created");
        Ok(case)
    }

    /// Cases, newest first.
    pub async fn list(&self, page: &Page) -> Result<Vec<Case>> {
        if let Some(case_id) = &page.after
            && self.journal.case(case_id).await?.is_none()
        {
            return Err(Error::page_token(case_id));
        }
        Ok(self.journal.cases(page).await?)
    }

    /// One case.
    pub async fn get(&self, case_id: &str) -> Result<Case> {
        self.journal
            .case(case_id)
            .await?
            .ok_or_else(|| Error::UnknownCase(case_id.to_owned()))
    }

    /// One of the large parts of a case.
    pub async fn blob(&self, case_id: &str, blob: Blob) -> Result<Bytes> {
        Ok(self.journal.blob(case_id, blob).await?)
    }

    /// The model as packed bytes.
    pub async fn packed_model(&self, case_id: &str) -> Result<PackedModel> {
        Ok(PackedModel {
            vertices: self.blob(case_id, Blob::Vertices).await?,
            triangles: self.blob(case_id, Blob::Triangles).await?,
            lesion: self.blob(case_id, Blob::Lesion).await?,
        })
    }

    /// The cell's calibrations.
    pub const fn calibrations(&self) -> &Calibrations {
        &self.calibrations
    }

    /// Where things are in the cell.
    pub fn cell(&self) -> Result<Arc<Cell>> {
        self.calibrations.cell().ok_or(Error::NotCalibrated)
    }

    /// The same, read anew, if its calibrations may be used now.
    pub async fn calibrated_cell(&self) -> Result<Arc<Cell>> {
        let cell = self.calibrations.refresh().await?;
        let cell = cell.ok_or(Error::NotCalibrated)?;
        cell.calibrations.usable(now_ms())?;
        Ok(cell)
    }

    /// Who must approve a plan.
    pub fn policy(&self) -> Policy {
        self.policy
    }

    /// Digest of the plan in force; `None` when there is no plan or no calibration.
    pub fn plan_digest(&self, case: &Case) -> Option<Digest> {
        let cell = self.calibrations.cell()?;
        let plan = case.plan.as_ref()?;
        let registration = case.registration.as_ref()?;
        let model = case.model.as_ref()?;
        Some(approval::plan_digest(
            plan,
            registration,
            &cell,
            model.digest,
        ))
    }

    /// Replaces the model.
    pub async fn store_model(
        &self,
        case_id: &str,
        model: PackedModel,
        lesion_spacing_mm: f64,
    ) -> Result<Case> {
        let hashed = model.clone();
        let digest = aside(move || {
            approval::model_digest(
                &hashed.vertices,
                &hashed.triangles,
                &hashed.lesion,
                lesion_spacing_mm,
            )
        });
        let info = ModelInfo {
            digest: digest.await,
            lesion_spacing_mm,
        };
        let blobs = [
            (Blob::Vertices, model.vertices),
            (Blob::Triangles, model.triangles),
            (Blob::Lesion, model.lesion),
        ];
        self.change(case_id, &blobs, |case| {
            case.replace_model(info);
            Ok(())
        })
        .await
    }

    /// Replaces the scene.
    pub async fn store_scene(&self, case_id: &str, scene: Scene) -> Result<Case> {
        let hashed = scene.points.clone();
        let digest = aside(move || approval::scene_digest(&hashed, scene.has_normals));
        let info = SceneInfo {
            digest: digest.await,
            point_count: scene.point_count,
            has_normals: scene.has_normals,
        };
        self.change(case_id, &[(Blob::Scene, scene.points)], |case| {
            case.replace_scene(info);
            Ok(())
        })
        .await
    }

    /// Keeps a registration that was computed for `revision` of the case.
    pub async fn keep_registration(
        &self,
        case_id: &str,
        revision: u64,
        registration: Registration,
        residuals: Bytes,
    ) -> Result<Case> {
        self.change(case_id, &[(Blob::Residuals, residuals)], |case| {
            unchanged(case, revision)?;
            case.register(registration)
        })
        .await
    }

    /// A person accepts the registration.
    pub async fn accept(&self, case_id: &str, acceptance: Acceptance) -> Result<Case> {
        self.change(case_id, &[], |case| case.accept(acceptance))
            .await
    }

    /// What touched landmarks are held to.
    pub const fn verification_limits(&self) -> &Limits {
        &self.verification
    }

    /// The landmarks touched for the registration in force with the calibrations in force.
    pub fn touches<'c>(&self, case: &'c Case) -> &'c [Touch] {
        match (&case.verification, self.verification_basis(case)) {
            (Some(verification), Some(basis)) if verification.basis == basis => {
                &verification.touches
            }
            _ => &[],
        }
    }

    /// What touches of this case are about; `None` before there is a registration.
    pub fn verification_basis(&self, case: &Case) -> Option<Digest> {
        let cell = self.calibrations.cell()?;
        let (model, scene) = case.model_and_scene().ok()?;
        let registration = case.registration.as_ref()?;
        Some(approval::verification_basis(
            model,
            scene,
            registration,
            &cell,
        ))
    }

    /// Keeps a touch that was measured for what has the digest `basis`.
    pub async fn touch(&self, case_id: &str, basis: Digest, touch: Touch) -> Result<Case> {
        self.note(case_id, |case| {
            if self.verification_basis(case) != Some(basis) {
                return Err(Error::CaseChanged);
            }
            let mut verification = case
                .verification
                .take()
                .filter(|verification| verification.basis == basis)
                .unwrap_or_else(|| Verification::new(basis));
            if !verification.touch(touch) {
                return Err(Error::invalid(
                    "landmark",
                    format!("is one more than {TOUCHES_MAX}, which a case holds at most"),
                ));
            }
            case.verification = Some(verification);
            Ok(())
        })
        .await
    }

    /// Takes a touch back.
    pub async fn remove_touch(&self, case_id: &str, landmark: &str) -> Result<Case> {
        self.note(case_id, |case| {
            let basis = self.verification_basis(case);
            let removed = match &mut case.verification {
                Some(verification) if Some(verification.basis) == basis => {
                    verification.remove(landmark)
                }
                _ => false,
            };
            match removed {
                true => Ok(()),
                false => Err(Error::UnknownLandmark(landmark.to_owned())),
            }
        })
        .await
    }

    /// Refuses a case whose touched landmarks speak against it, or are not enough where that is asked for.
    fn verified(&self, case: &Case) -> Result<()> {
        let limits = &self.verification;
        let finding = Finding::of(self.touches(case), limits);
        match finding.verdict {
            Verdict::Failed => Err(Error::VerificationFailed {
                rms_mm: finding.rms_mm,
                limit_mm: limits.limit_mm,
            }),
            Verdict::Absent | Verdict::Pending if limits.required => Err(Error::NotVerified {
                missing: finding.missing,
            }),
            Verdict::Absent | Verdict::Pending | Verdict::Passed => Ok(()),
        }
    }

    /// Keeps a plan that was computed for `revision` of the case.
    pub async fn keep_plan(&self, case_id: &str, revision: u64, plan: Plan) -> Result<Case> {
        self.change(case_id, &[], |case| {
            unchanged(case, revision)?;
            case.replace_plan(plan)
        })
        .await
    }

    /// A surgeon approves the plan with this digest.
    pub async fn approve(
        &self,
        case_id: &str,
        surgeon: Signatory,
        who: Who,
        seen: Digest,
    ) -> Result<Case> {
        self.sign(case_id, surgeon, who, seen, Case::approve).await
    }

    /// A second person puts their name to the plan with this digest.
    pub async fn countersign(
        &self,
        case_id: &str,
        person: Signatory,
        who: Who,
        seen: Digest,
    ) -> Result<Case> {
        self.sign(case_id, person, who, seen, Case::countersign)
            .await
    }

    /// The name stands in the audit before it counts.
    async fn sign(
        &self,
        case_id: &str,
        signatory: Signatory,
        who: Who,
        seen: Digest,
        rule: impl FnOnce(&mut Case, Signatory, Digest, Digest, Policy) -> Result<()>,
    ) -> Result<Case> {
        self.calibrated_cell().await?;
        let _changing = self.changing.lock().await;
        let mut case = self.get(case_id).await?;
        let current = self.plan_digest(&case).ok_or(Error::NotPlanned)?;
        let mut entry = Entry::new(now_ms(), Kind::Approval, who);
        entry.stated.clone_from(&signatory.name);
        self.verified(&case)?;
        rule(&mut case, signatory, seen, current, self.policy)?;
        entry.case_id.clone_from(&case.id);
        entry.plan = Some(current);
        let complete = case.stage(Some(current), self.policy) == Stage::Approved;
        entry.code = match complete {
            true => "APPROVED".to_owned(),
            false => "SECOND_APPROVAL_NEEDED".to_owned(),
        };
        self.audit.record(entry).await?;
        case.revision += 1;
        self.journal.save_case(&case, &[]).await?;
        Ok(case)
    }

    /// The plan with this digest, if it may be begun or resumed: in force and approved, its calibrations not expired, and
    /// no touched landmark against it.
    pub async fn approved(&self, case_id: &str, digest: Digest) -> Result<Approved> {
        self.calibrated_cell().await?;
        let approved = self.still_approved(case_id, digest).await?;
        self.verified(&self.get(case_id).await?)?;
        Ok(approved)
    }

    /// The plan with this digest, if it may be gone on with: in force and approved, its calibrations not revoked. Read from
    /// the journal each time, so that an approval voided a moment ago is void.
    pub async fn still_approved(&self, case_id: &str, digest: Digest) -> Result<Approved> {
        let cell = self.calibrations.refresh().await?;
        let cell = cell.ok_or(Error::NotCalibrated)?;
        cell.calibrations.not_revoked()?;
        let case = self.get(case_id).await?;
        let current = self.plan_digest(&case);
        if current != Some(digest) {
            return Err(Error::ApprovalVoid {
                approved: digest,
                current: current.map_or_else(|| "none".to_owned(), |digest| digest.to_string()),
            });
        }
        let approval = case
            .approval_of(digest)
            .ok_or(Error::NotApproved { digest })?;
        if !approval.is_complete(self.policy) {
            return Err(Error::SecondApprovalNeeded {
                digest,
                approved_by: approval.surgeon.name.clone(),
            });
        }
        let registration = case.accepted()?.clone();
        let plan = case.plan.ok_or(Error::NotPlanned)?;
        Ok(Approved {
            plan,
            registration,
            cell,
        })
    }

    async fn change(
        &self,
        case_id: &str,
        blobs: &[(Blob, Bytes)],
        rule: impl FnOnce(&mut Case) -> Result<()>,
    ) -> Result<Case> {
        let _changing = self.changing.lock().await;
        let mut case = self.get(case_id).await?;
        rule(&mut case)?;
        case.revision += 1;
        self.journal.save_case(&case, blobs).await?;
        Ok(case)
    }

    /// A change that leaves what is being computed for the case as good as it was.
    async fn note(
        &self,
        case_id: &str,
        rule: impl FnOnce(&mut Case) -> Result<()>,
    ) -> Result<Case> {
        self.calibrations.refresh().await?;
        let _changing = self.changing.lock().await;
        let mut case = self.get(case_id).await?;
        rule(&mut case)?;
        self.journal.save_case(&case, &[]).await?;
        Ok(case)
    }
}

fn unchanged(case: &Case, revision: u64) -> Result<()> {
    if case.revision == revision {
        return Ok(());
    }
    Err(Error::CaseChanged)
}
