//! `AuditService`.

use arthro_proto::gateway::v1 as proto;
use arthro_proto::gateway::v1::audit_service_server::AuditService;
use tokio::sync::mpsc;
use tonic::{Request, Response, Status};

use super::case::streamed;
use super::{Answers, paging, refuse};
use crate::audit::entry::{Kind, Link};
use crate::audit::read::{JournalCheck, Pages, Verdict};
use crate::audit::verify::{Defect, Fault, Head};
use crate::audit::{Audit, heads, lines};
use crate::error::{Error, Result as DomainResult};
use crate::journal::AuditFilter;

/// Serves the audit.
#[derive(Clone)]
pub(super) struct AuditApi(Audit);

impl AuditApi {
    pub(super) fn new(audit: Audit) -> Self {
        Self(audit)
    }
}

#[tonic::async_trait]
impl AuditService for AuditApi {
    async fn list_entries(
        &self,
        request: Request<proto::ListEntriesRequest>,
    ) -> Result<Response<proto::ListEntriesResponse>, Status> {
        let request = request.into_inner();
        let page = paging::size(request.page_size).map_err(refuse)?;
        let filter = filter(request);
        let mut rows = self
            .0
            .journal()
            .audit(&filter, page + 1)
            .await
            .map_err(refuse)?;
        let next = rows.get(page as usize).map_or(0, |row| row.sequence);
        rows.truncate(page as usize);
        let entries = rows
            .into_iter()
            .map(|row| match row.link {
                Ok(link) => proto::ListedEntry {
                    entry: Some(entry_message(&link)),
                    damage: String::new(),
                },
                Err(damage) => proto::ListedEntry {
                    entry: Some(proto::AuditEntry {
                        sequence: row.sequence,
                        ..proto::AuditEntry::default()
                    }),
                    damage,
                },
            })
            .collect();
        Ok(Response::new(proto::ListEntriesResponse {
            entries,
            next_sequence: next,
        }))
    }

    type VerifyChainStream = Answers<proto::VerifyChainResponse>;

    async fn verify_chain(
        &self,
        _: Request<proto::VerifyChainRequest>,
    ) -> Result<Response<Self::VerifyChainStream>, Status> {
        let this = self.clone();
        Ok(Response::new(streamed(move |answers| async move {
            this.verify(&answers).await
        })))
    }

    type ExportEntriesStream = Answers<proto::ExportEntriesResponse>;

    async fn export_entries(
        &self,
        _: Request<proto::ExportEntriesRequest>,
    ) -> Result<Response<Self::ExportEntriesStream>, Status> {
        let this = self.clone();
        Ok(Response::new(streamed(move |answers| async move {
            this.export(&answers).await
        })))
    }

    async fn get_head(
        &self,
        _: Request<proto::GetHeadRequest>,
    ) -> Result<Response<proto::GetHeadResponse>, Status> {
        Ok(Response::new(self.head().await.map_err(refuse)?))
    }
}

impl AuditApi {
    async fn verify(
        &self,
        answers: &mpsc::Sender<Result<proto::VerifyChainResponse, Status>>,
    ) -> DomainResult<()> {
        // The heads first: what is written meanwhile is in the chain before its head is in the file.
        let (heads, mut verdict) = match self.kept_heads().await {
            Ok(heads) => (heads, None),
            Err(defect) => (Vec::new(), Some(Err(defect))),
        };
        let count = heads.len() as u64;
        let keys = self.0.keys().to_vec();
        let mut check = JournalCheck::new(self.0.journal().as_ref(), keys, heads);
        let verdict = loop {
            if let Some(verdict) = verdict {
                break verdict;
            }
            verdict = check.next().await?;
            let progress = proto::VerifyChainResponse {
                checked: check.checked(),
                verdict: None,
            };
            if answers.send(Ok(progress)).await.is_err() {
                return Ok(());
            }
        };
        let last = proto::VerifyChainResponse {
            checked: check.checked(),
            verdict: Some(verdict_message(&verdict, count)),
        };
        answers.send(Ok(last)).await.ok();
        Ok(())
    }

    async fn kept_heads(&self) -> Result<Vec<Head>, Defect> {
        let path = self.0.heads();
        let text = tokio::fs::read_to_string(path).await.map_err(|error| {
            let detail = format!("{} cannot be read: {error}", path.display());
            Defect::new(Fault::HeadDamaged, 0, detail)
        })?;
        heads::parse(&text)
    }

    async fn export(
        &self,
        answers: &mpsc::Sender<Result<proto::ExportEntriesResponse, Status>>,
    ) -> DomainResult<()> {
        let mut pages = Pages::new(self.0.journal().as_ref(), AuditFilter::default());
        loop {
            let rows = pages.next().await?;
            if rows.is_empty() {
                return Ok(());
            }
            let mut text = String::new();
            for row in rows {
                let line = row
                    .link
                    .and_then(|link| lines::entry(&link).map_err(|error| error.to_string()));
                match line {
                    Ok(line) => {
                        text.push_str(&line);
                        text.push('\n');
                    }
                    Err(problem) => {
                        return Err(Error::AuditDamaged {
                            sequence: row.sequence,
                            problem,
                        });
                    }
                }
            }
            let answer = proto::ExportEntriesResponse { lines: text.into() };
            if answers.send(Ok(answer)).await.is_err() {
                return Ok(());
            }
        }
    }

    async fn head(&self) -> DomainResult<proto::GetHeadResponse> {
        let newest = AuditFilter {
            newest_first: true,
            ..AuditFilter::default()
        };
        let public_key = self
            .0
            .keys()
            .last()
            .map_or_else(String::new, |key| key.to_pem());
        let rows = self.0.journal().audit(&newest, 1).await?;
        let Some(row) = rows.into_iter().next() else {
            return Ok(proto::GetHeadResponse {
                public_key,
                ..proto::GetHeadResponse::default()
            });
        };
        let damaged = |problem| Error::AuditDamaged {
            sequence: row.sequence,
            problem,
        };
        let link = row.link.map_err(damaged)?;
        let head = Head::from(&link);
        Ok(proto::GetHeadResponse {
            sequence: link.sequence,
            hash: link.hash.to_string(),
            key_id: link.key.to_string(),
            signature: lines::hexadecimal(&link.signature),
            line: lines::head(&head).map_err(|error| damaged(error.to_string()))?,
            public_key,
        })
    }
}

// === reading ===

fn filter(request: proto::ListEntriesRequest) -> AuditFilter {
    let all = AuditFilter::default();
    let kind = kind_of(request.kind());
    AuditFilter {
        first: if request.newest_first {
            0
        } else {
            request.from_sequence
        },
        last: match request.from_sequence {
            from if request.newest_first && from > 0 => from,
            _ => all.last,
        },
        kind,
        name: request.name,
        case_id: request.case_id,
        procedure_id: request.procedure_id,
        from_ms: match request.from_ms {
            0 => all.from_ms,
            from_ms => from_ms,
        },
        to_ms: match request.to_ms {
            0 => all.to_ms,
            to_ms => to_ms,
        },
        newest_first: request.newest_first,
    }
}

fn kind_of(kind: proto::AuditKind) -> Option<Kind> {
    Kind::ALL
        .iter()
        .copied()
        .find(|known| kind_message(*known) == kind)
}

// === writing ===

fn verdict_message(verdict: &Verdict, heads: u64) -> proto::AuditVerdict {
    match verdict {
        Ok(_) => proto::AuditVerdict {
            whole: true,
            heads,
            ..proto::AuditVerdict::default()
        },
        Err(defect) => proto::AuditVerdict {
            whole: false,
            fault: defect.fault.as_str().to_owned(),
            sequence: defect.sequence,
            detail: defect.detail.clone(),
            heads,
        },
    }
}

fn entry_message(link: &Link) -> proto::AuditEntry {
    let text = |digest: Option<crate::approval::Digest>| {
        digest.map_or_else(String::new, |digest| digest.to_string())
    };
    let entry = &link.entry;
    proto::AuditEntry {
        sequence: link.sequence,
        previous: link.previous.to_string(),
        at_ms: entry.at_ms,
        kind: kind_message(entry.kind).into(),
        name: entry.who.name.clone(),
        role: entry.who.role.clone(),
        peer: entry.who.peer.clone(),
        stated: entry.stated.clone(),
        method: entry.method.clone(),
        case_id: entry.case_id.clone(),
        procedure_id: entry.procedure_id.clone(),
        request_digest: text(entry.request),
        plan_digest: text(entry.plan),
        answers: entry.answers,
        code: entry.code.clone(),
        reason: entry.reason.clone(),
        detail: entry.detail.clone(),
        hash: link.hash.to_string(),
        key_id: link.key.to_string(),
        signature: lines::hexadecimal(&link.signature),
    }
}

fn kind_message(kind: Kind) -> proto::AuditKind {
    match kind {
        Kind::Start => proto::AuditKind::Start,
        Kind::End => proto::AuditKind::End,
        Kind::Command => proto::AuditKind::Command,
        Kind::Decision => proto::AuditKind::Decision,
        Kind::Stop => proto::AuditKind::Stop,
        Kind::Outcome => proto::AuditKind::Outcome,
        Kind::Refusal => proto::AuditKind::Refusal,
        Kind::Approval => proto::AuditKind::Approval,
        Kind::Procedure => proto::AuditKind::Procedure,
        Kind::Alarm => proto::AuditKind::Alarm,
    }
}
