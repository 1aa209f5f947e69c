//! Touched landmarks and predicted errors of a case.

use arthro_bootstrap::Caller;
use arthro_proto::gateway::v1 as proto;
use arthro_proto::registration::v1 as registration;

use super::super::{Violations, id, person, text};
use super::{CaseApi, decoded};
use crate::cases::case::Case;
use crate::clients::motion::{Arm, TipWatch};
use crate::error::{Error, Result as DomainResult};
use crate::error_budget::Sources;
use crate::procedure::poses::base_from_ct;
use crate::verification::Touch;
use crate::wall_clock::now_ms;
use crate::wire;

impl CaseApi {
    /// Reads the tip, and keeps how far it is from where the landmark should be.
    pub(super) async fn verify(
        &self,
        caller: &Caller,
        request: proto::VerifyTargetRequest,
    ) -> DomainResult<proto::VerifyTargetResponse> {
        let mut violations = Violations::default();
        let case_id = violations.check(id("case_id", request.case_id));
        let landmark = violations.check(text("landmark", request.landmark, 100));
        let point = violations.check(wire::point(request.point, "point"));
        let operator = violations.check(person(caller, "operator", request.operator));
        violations.finish()?;
        let (Some(case_id), Some(landmark), Some(point), Some(operator)) =
            (case_id, landmark, point, operator)
        else {
            return Err(Error::Invalid(Vec::new()));
        };
        let cell = self.cases.calibrated_cell().await?;
        let case = self.cases.get(&case_id).await?;
        let registration = case.registration.as_ref().ok_or(Error::NotRegistered)?;
        let basis = self.cases.verification_basis(&case);
        let basis = basis.ok_or(Error::NotRegistered)?;
        let tip = match self.clients.motion.watch_tip(Arm::Forceps).await? {
            TipWatch::Still(tip) => tip,
            TipWatch::Moving { moved_mm } => return Err(Error::ArmMoving { moved_mm }),
            TipWatch::NotConnected => return Err(Error::ArmNotConnected),
        };
        let touch = Touch {
            landmark,
            point,
            expected: base_from_ct(registration, &cell) * point,
            tip,
            operator,
            touched_at_ms: now_ms(),
        };
        let case = self.cases.touch(&case_id, basis, touch.clone()).await?;
        Ok(proto::VerifyTargetResponse {
            touch: Some(wire::touch_message(&touch)),
            verification: Some(self.verification_message(&case)),
        })
    }

    /// Takes a touch back.
    pub(super) async fn take_back(
        &self,
        caller: &Caller,
        request: proto::RemoveTouchRequest,
    ) -> DomainResult<proto::RemoveTouchResponse> {
        let case_id = id("case_id", request.case_id)?;
        let landmark = text("landmark", request.landmark, 100)?;
        let operator = person(caller, "operator", request.operator)?;
        let case = self.cases.remove_touch(&case_id, &landmark).await?;
        tracing::info!(case_id, landmark, operator, "touch removed");
        Ok(proto::RemoveTouchResponse {
            verification: Some(self.verification_message(&case)),
        })
    }

    /// What was touched, judged.
    pub(super) fn verification_message(&self, case: &Case) -> proto::Verification {
        let touches = self.cases.touches(case);
        wire::verification_message(touches, self.cases.verification_limits())
    }

    /// How far the bites of the plan in force are expected to be off; `None` without plan or calibration.
    pub(super) fn predicted_errors(&self, case: &Case) -> Option<proto::PredictedErrors> {
        let cell = self.cases.calibrations().cell()?;
        let plan = case.plan.as_ref()?;
        let registration = case.registration.as_ref()?;
        let result = decoded::<registration::RegistrationResult>(&registration.encoded);
        let sources = Sources::of(
            wire::uncertainty(&result),
            &cell.calibrations,
            self.error_budget.arm_accuracy_mm,
        );
        let bites = plan.bites.iter();
        let errors: Vec<_> = bites
            .map(|bite| sources.bite(bite, registration, &cell))
            .collect();
        Some(wire::errors_message(&errors, &sources, &self.error_budget))
    }
}
