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
use crate::cases::case::{Case, ModelInfo, Plan, Registration, SceneInfo, Stage};
use crate::clients::planning::PackedModel;
use crate::config::Cell;
use crate::error::{Error, Result};
use crate::journal::{Blob, Journal};
use crate::wall_clock::now_ms;

/// The cases of this gateway.
#[derive(Clone)]
pub struct Cases {
    journal: Arc<dyn Journal>,
    cell: Option<Arc<Cell>>,
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
    /// Cases of a journal, in a cell that may not be calibrated yet.
    pub fn new(
        journal: Arc<dyn Journal>,
        cell: Option<Cell>,
        policy: Policy,
        audit: Audit,
    ) -> Self {
        Self {
            journal,
            cell: cell.map(Arc::new),
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

    /// All cases, newest first.
    pub async fn list(&self) -> Result<Vec<Case>> {
        Ok(self.journal.cases().await?)
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

    /// Where things are in the cell.
    pub fn cell(&self) -> Result<&Arc<Cell>> {
        self.cell.as_ref().ok_or(Error::NotCalibrated)
    }

    /// Who must approve a plan.
    pub fn policy(&self) -> Policy {
        self.policy
    }

    /// Digest of the plan in force; `None` when there is no plan or no calibration.
    pub fn plan_digest(&self, case: &Case) -> Option<Digest> {
        let (Some(plan), Some(registration), Some(model), Some(cell)) =
            (&case.plan, &case.registration, &case.model, &self.cell)
        else {
            return None;
        };
        Some(approval::plan_digest(
            plan,
            registration,
            cell,
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
    pub async fn accept(&self, case_id: &str, operator: String) -> Result<Case> {
        self.change(case_id, &[], |case| case.accept(operator))
            .await
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
        self.cell()?;
        let _changing = self.changing.lock().await;
        let mut case = self.get(case_id).await?;
        let current = self.plan_digest(&case).ok_or(Error::NotPlanned)?;
        let mut entry = Entry::new(now_ms(), Kind::Approval, who);
        entry.stated.clone_from(&signatory.name);
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

    /// The plan with this digest, if it is in force and approved. Read from the journal each time, so that an approval
    /// voided a moment ago is void.
    pub async fn approved(&self, case_id: &str, digest: Digest) -> Result<Approved> {
        let cell = self.cell()?.clone();
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
}

fn unchanged(case: &Case, revision: u64) -> Result<()> {
    if case.revision == revision {
        return Ok(());
    }
    Err(Error::CaseChanged)
}
