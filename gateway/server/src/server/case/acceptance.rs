//! Who accepts a registration, and as what.

use arthro_bootstrap::{Caller, Role};
use arthro_proto::gateway::v1 as proto;

use super::super::text;
use crate::cases::case::Acceptance;
use crate::error::Violation;
use crate::wall_clock::now_ms;

/// A certificate says name and role; without one, whoever is stated as the surgeon is, and else the operator.
pub(super) fn acceptance(
    caller: &Caller,
    request: &proto::AcceptRegistrationRequest,
) -> Result<Acceptance, Violation> {
    let (operator, surgeon) = (request.operator.clone(), request.surgeon.clone());
    let (by, role) = match caller {
        Caller::Local if surgeon.is_empty() => (text("operator", operator, 100)?, Role::Operator),
        Caller::Local => (text("surgeon", surgeon, 100)?, Role::Surgeon),
        Caller::Certified { role, .. } => {
            if *role != Role::Surgeon && !surgeon.is_empty() {
                let problem = format!("is {surgeon:?}, but the certificate's role is {role}");
                return Err(Violation::new("surgeon", problem));
            }
            for (field, stated) in [("operator", operator), ("surgeon", surgeon)] {
                let acting = caller.acting(stated);
                acting.map_err(|other| Violation::new(field, other.to_string()))?;
            }
            (caller.name().to_owned(), *role)
        }
    };
    Ok(Acceptance {
        by,
        role,
        at_ms: now_ms(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stated(operator: &str, surgeon: &str) -> proto::AcceptRegistrationRequest {
        proto::AcceptRegistrationRequest {
            operator: operator.to_owned(),
            surgeon: surgeon.to_owned(),
            ..proto::AcceptRegistrationRequest::default()
        }
    }

    fn certified(role: Role) -> Caller {
        Caller::Certified {
            name: "Dr. Adams".to_owned(),
            role,
        }
    }

    fn who(caller: &Caller, operator: &str, surgeon: &str) -> Result<(String, Role), String> {
        acceptance(caller, &stated(operator, surgeon))
            .map(|acceptance| (acceptance.by, acceptance.role))
            .map_err(|violation| violation.field)
    }

    #[test]
    fn at_the_machine_itself_the_stated_surgeon_accepts_before_the_operator() {
        let local = Caller::Local;
        assert_eq!(who(&local, "a", ""), Ok(("a".to_owned(), Role::Operator)));
        assert_eq!(who(&local, "a", "b"), Ok(("b".to_owned(), Role::Surgeon)));
        assert_eq!(who(&local, "", ""), Err("operator".to_owned()));
    }

    #[test]
    fn a_certificate_decides_who_accepts_and_as_what() {
        let surgeon = Ok(("Dr. Adams".to_owned(), Role::Surgeon));
        assert_eq!(who(&certified(Role::Surgeon), "", ""), surgeon);
        assert_eq!(who(&certified(Role::Surgeon), "", "Dr. Adams"), surgeon);
        let brown = who(&certified(Role::Surgeon), "", "Dr. Brown");
        assert_eq!(brown, Err("surgeon".to_owned()));
    }

    #[test]
    fn an_operators_certificate_cannot_state_a_surgeon() {
        let operator = certified(Role::Operator);
        let accepted = who(&operator, "", "");
        assert_eq!(accepted, Ok(("Dr. Adams".to_owned(), Role::Operator)));
        for surgeon in ["Dr. Adams", "Dr. Brown"] {
            assert_eq!(who(&operator, "", surgeon), Err("surgeon".to_owned()));
        }
    }
}
