//! The command that reads and checks the record of who did what.

use std::path::PathBuf;

use clap::{ArgGroup, Args, Subcommand, ValueEnum};

#[derive(Debug, Subcommand)]
pub enum Audit {
    /// Lists entries, the newest last.
    List(AuditList),
    /// Checks that nothing was edited, removed, reordered or cut off: by the gateway, or from files without any server.
    Verify(AuditVerify),
    /// Writes all entries as JSON lines, and the key that checks them.
    Export(AuditExport),
}

#[derive(Debug, Args)]
pub struct AuditList {
    /// How many, the newest.
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub last: u32,
    /// Only of this case.
    #[arg(long)]
    pub case: Option<String>,
    /// Only of this procedure.
    #[arg(long)]
    pub procedure: Option<String>,
    /// Only what this person did.
    #[arg(long)]
    pub name: Option<String>,
    /// Only of this kind.
    #[arg(long, value_enum)]
    pub kind: Option<AuditKindName>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum AuditKindName {
    Start,
    End,
    Command,
    Decision,
    Stop,
    Outcome,
    Refusal,
    Approval,
    Procedure,
    Alarm,
}

/// Without a file the gateway checks its own chain.
#[derive(Debug, Args)]
#[command(group = ArgGroup::new("chain").args(["journal", "export"]))]
pub struct AuditVerify {
    /// Checks this journal file; a gateway may be running on it.
    #[arg(long, value_name = "FILE", requires_all = ["heads", "keys"])]
    pub journal: Option<PathBuf>,
    /// Checks this export.
    #[arg(long, value_name = "FILE", requires_all = ["heads", "keys"])]
    pub export: Option<PathBuf>,
    /// The heads that were kept; of each gateway that wrote the chain.
    #[arg(long, value_name = "FILE", requires = "chain")]
    pub heads: Vec<PathBuf>,
    /// The public key (`….audit-key.pub`); of each gateway that wrote the chain.
    #[arg(long = "key", value_name = "FILE", requires = "chain")]
    pub keys: Vec<PathBuf>,
}

#[derive(Debug, Args)]
pub struct AuditExport {
    /// Where the entries go.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Where the gateway's public key goes.
    #[arg(long, value_name = "FILE")]
    pub key: Option<PathBuf>,
}
