//! The commands that talk CANopen with the drives.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

/// Node ids of CANopen.
fn node_id(text: &str) -> Result<u8, String> {
    text.parse()
        .ok()
        .filter(|id| (1..=127).contains(id))
        .ok_or_else(|| "must be 1 to 127".to_owned())
}

fn seconds(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|seconds| (0.001..=1e6).contains(seconds))
        .ok_or_else(|| "must be 0.001 to 1000000 s".to_owned())
}

#[derive(Debug, Args)]
pub struct Can {
    /// The bus: socketcan:INTERFACE, or socketcand://HOST:PORT/BUS.
    #[arg(
        long,
        global = true,
        env = "ARTHRO_CAN",
        default_value = "socketcan:can0"
    )]
    pub bus: String,
    /// How long a node may take to answer, ms.
    #[arg(long, global = true, default_value_t = 500, value_parser = clap::value_parser!(u64).range(1..=60_000))]
    pub answer_ms: u64,
    #[command(subcommand)]
    pub command: CanCommand,
}

#[derive(Debug, Subcommand)]
pub enum CanCommand {
    /// Shows what is on the bus, a line a frame as `candump -L` has it, with its meaning. Sends nothing.
    Dump(Dump),
    /// Reads or writes one object of a node.
    #[command(subcommand)]
    Sdo(Sdo),
    /// Asks every node id who is there.
    Nodes,
    /// Orders the NMT state of a node or of all, and waits for the heartbeat that tells it.
    Nmt(NmtOrder),
    /// Shows the errors of a node: the present one, the register, the history, and what to do.
    Faults(Faults),
    /// Writes the electronic data sheet (EDS) of the drive, for other tools. Needs no bus.
    Eds(Eds),
}

#[derive(Debug, Args)]
pub struct Dump {
    /// Log lines alone, as `canplayer` and `log2asc` read them.
    #[arg(long)]
    pub raw: bool,
    /// Ends after so many frames.
    #[arg(long)]
    pub count: Option<u64>,
    /// Ends after so many seconds.
    #[arg(long = "for", value_name = "SECONDS", value_parser = seconds)]
    pub seconds: Option<f64>,
}

#[derive(Debug, Subcommand)]
pub enum Sdo {
    /// Reads an object and says what it means.
    Read(SdoRead),
    /// Writes an object once type and range are found to fit, and reads it back.
    Write(SdoWrite),
}

#[derive(Debug, Args)]
pub struct SdoRead {
    /// Node id, 1 to 127.
    #[arg(value_parser = node_id)]
    pub node: u8,
    /// Name in the manual such as `statusword`, or index and subindex: `6041`, `0x3001:02`.
    pub object: String,
    /// Type of an object that this program does not know.
    #[arg(long = "type", value_enum)]
    pub kind: Option<ObjectKind>,
}

#[derive(Debug, Args)]
pub struct SdoWrite {
    /// Node id, 1 to 127.
    #[arg(value_parser = node_id)]
    pub node: u8,
    /// Name in the manual such as `profile velocity`, or index and subindex: `6081`, `0x3001:02`.
    pub object: String,
    /// Decimal or 0x hexadecimal; `save` and `load` for 1010:01 and 1011:01.
    #[arg(allow_hyphen_values = true)]
    pub value: String,
    /// Type of an object that this program does not know.
    #[arg(long = "type", value_enum)]
    pub kind: Option<ObjectKind>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ObjectKind {
    U8,
    U16,
    U32,
    I8,
    I16,
    I32,
}

#[derive(Debug, Args)]
pub struct NmtOrder {
    /// Node id, 1 to 127, or `all`.
    #[arg(value_name = "NODE|all", value_parser = nmt_target)]
    pub target: NmtTarget,
    /// What is ordered.
    #[arg(value_enum)]
    pub command: NmtCommand,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NmtTarget {
    All,
    Node(u8),
}

fn nmt_target(text: &str) -> Result<NmtTarget, String> {
    match text {
        "all" => Ok(NmtTarget::All),
        _ => node_id(text)
            .map(NmtTarget::Node)
            .map_err(|_| "must be 1 to 127, or all".to_owned()),
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum NmtCommand {
    /// To OPERATIONAL.
    Start,
    /// To STOPPED.
    Stop,
    /// To PRE_OPERATIONAL.
    Pre,
    /// Like a power cycle.
    Reset,
    /// Restarts the communication alone.
    ResetComm,
}

#[derive(Debug, Args)]
pub struct Faults {
    /// Node id, 1 to 127.
    #[arg(value_parser = node_id)]
    pub node: u8,
    /// Forgets the history; a present error stays.
    #[arg(long)]
    pub clear_history: bool,
}

#[derive(Debug, Args)]
pub struct Eds {
    /// Where the file goes; standard output if not given.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Writes defaults for this node instead of `$NODEID+...`.
    #[arg(long, value_parser = node_id)]
    pub node_id: Option<u8>,
}
