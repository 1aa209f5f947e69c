//! A PostgreSQL server of the tests' own: in a temporary folder, on a socket of that folder, gone with the last test
//! that uses it. Shared by the tests of one process, each of which gets a database of its own.
//!
//! The programs are those of `PATH` or of Debian's packages, installed or unpacked below `ARTHRO_POSTGRES`.

use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError, Weak};

use sqlx::Connection as _;
use sqlx::postgres::PgConnection;
use tempfile::TempDir;
use uuid::Uuid;

/// A database that is dropped with its server.
pub struct Database {
    server: Arc<Server>,
    name: String,
}

struct Server {
    process: Process,
    folder: TempDir,
}

/// The server's process, below a shell that ends it when its standard input closes, so that it does not outlive the tests.
struct Process(Child);

static SHARED: Mutex<Weak<Server>> = Mutex::new(Weak::new());

/// Who runs the server when the tests run as root, which PostgreSQL refuses.
const NOBODY: u32 = 65534;

impl Database {
    /// An empty database.
    pub async fn new() -> Self {
        Self::on(tokio::task::spawn_blocking(Server::shared).await.unwrap()).await
    }

    /// The same on a server that no other test uses, so that it may die.
    #[allow(
        dead_code,
        reason = "not every program that shares this file lets it die"
    )]
    pub async fn alone() -> Self {
        let server = tokio::task::spawn_blocking(Server::start).await.unwrap();
        Self::on(Arc::new(server)).await
    }

    /// Ends the server as a crash would: nothing is written any more and every connection breaks.
    #[allow(
        dead_code,
        reason = "not every program that shares this file lets it die"
    )]
    pub fn die(&mut self) {
        self.own_server().process.end();
    }

    /// Starts the server again on what it has written.
    #[allow(
        dead_code,
        reason = "not every program that shares this file lets it die"
    )]
    pub fn come_back(&mut self) {
        let server = self.own_server();
        server.process = Process::start(server.folder.path());
    }

    fn own_server(&mut self) -> &mut Server {
        Arc::get_mut(&mut self.server).expect("the server is this test's alone")
    }

    async fn on(server: Arc<Server>) -> Self {
        let database = Self {
            name: format!("test_{}", Uuid::now_v7().simple()),
            server,
        };
        let mut connection = PgConnection::connect(&database.server.address("postgres"))
            .await
            .unwrap();
        let create = sqlx::AssertSqlSafe(format!("CREATE DATABASE {}", database.name));
        sqlx::raw_sql(create)
            .execute(&mut connection)
            .await
            .unwrap();
        connection.close().await.unwrap();
        database
    }

    /// As it stands in `gateway.journal`.
    pub fn address(&self) -> String {
        self.server.address(&self.name)
    }
}

impl Server {
    fn shared() -> Arc<Self> {
        let mut shared = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(server) = shared.upgrade() {
            return server;
        }
        let server = Arc::new(Self::start());
        *shared = Arc::downgrade(&server);
        server
    }

    fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        if is_root() {
            std::os::unix::fs::chown(folder.path(), Some(NOBODY), Some(NOBODY)).unwrap();
        }
        let data = folder.path().join("data");
        let made = as_nobody(&program("initdb"))
            .envs(libraries())
            .arg("--pgdata")
            .arg(&data)
            .args(["--username=arthro", "--auth=trust", "--encoding=UTF8"])
            .args(["--locale=C", "--no-sync"])
            .current_dir(folder.path())
            .output()
            .unwrap();
        assert!(
            made.status.success(),
            "initdb: {}",
            String::from_utf8_lossy(&made.stderr)
        );
        Self {
            process: Process::start(folder.path()),
            folder,
        }
    }

    fn address(&self, database: &str) -> String {
        let socket = self.folder.path().display();
        format!("postgres://arthro@localhost/{database}?host={socket}")
    }
}

impl Process {
    /// Of the data in a folder; its socket is there too.
    fn start(folder: &Path) -> Self {
        let postgres = as_nobody(&program("postgres"));
        let mut shell = Command::new("sh")
            .args([
                "-c",
                r#""$@" 2>&1 & read -r line; kill -QUIT $!; wait $!"#,
                "sh",
            ])
            .arg(postgres.get_program())
            .args(postgres.get_args())
            .arg("-D")
            .arg(folder.join("data"))
            .arg("-k")
            .arg(folder)
            .args(["-h", "", "-c", "shared_buffers=16MB"])
            .envs(libraries())
            .current_dir(folder)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut log = BufReader::new(shell.stdout.take().unwrap());
        let mut said = String::new();
        while !said.contains("ready to accept connections") {
            let read = log.read_line(&mut said).unwrap();
            assert!(read > 0, "postgres ended: {said}");
        }
        // Whoever does not read on stops the server once the pipe is full.
        std::thread::spawn(move || std::io::copy(&mut log, &mut std::io::sink()));
        Self(shell)
    }

    fn end(&mut self) {
        drop(self.0.stdin.take());
        self.0.wait().unwrap();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.end();
    }
}

/// Runs a program as a user that may own a database, and may not write what root may.
pub fn as_nobody(program: &Path) -> Command {
    if !is_root() {
        return Command::new(program);
    }
    let mut command = Command::new("setpriv");
    command
        .args([
            format!("--reuid={NOBODY}"),
            format!("--regid={NOBODY}"),
            "--clear-groups".to_owned(),
        ])
        .arg(program);
    command
}

fn is_root() -> bool {
    use std::os::unix::fs::MetadataExt as _;
    std::fs::metadata("/proc/self").unwrap().uid() == 0
}

/// Where unpacked programs find the libraries that were unpacked with them.
fn libraries() -> Option<(&'static str, PathBuf)> {
    let root = PathBuf::from(std::env::var_os("ARTHRO_POSTGRES")?);
    let entries = std::fs::read_dir(root.join("usr/lib")).ok()?;
    let folder = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .find(|path| path.to_string_lossy().ends_with("-linux-gnu"))?;
    Some(("LD_LIBRARY_PATH", folder))
}

/// The newest of the machine's, unless a folder is named.
fn program(name: &str) -> PathBuf {
    let root = std::env::var_os("ARTHRO_POSTGRES").map_or_else(|| "/".into(), PathBuf::from);
    let mut versions: Vec<(u32, PathBuf)> = std::fs::read_dir(root.join("usr/lib/postgresql"))
        .into_iter()
        .flatten()
        .filter_map(|entry| {
            let entry = entry.ok()?;
            let version = entry.file_name().to_str()?.parse().ok()?;
            Some((version, entry.path().join("bin").join(name)))
        })
        .filter(|(_, program)| program.exists())
        .collect();
    versions.sort();
    if let Some((_, newest)) = versions.pop() {
        return newest;
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path)
        .map(|folder| folder.join(name))
        .find(|program| program.exists())
        .unwrap_or_else(|| {
            panic!("{name} of PostgreSQL 13 or newer is needed: install it, or name an unpacked folder in ARTHRO_POSTGRES")
        })
}
