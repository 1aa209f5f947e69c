use arthro_bootstrap::{Credentials, Role};
use tempfile::TempDir;

use super::*;

struct World {
    folder: TempDir,
    site: Site,
}

impl World {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let site = Site::init(folder.path(), "a hospital", 1000).unwrap();
        Self { folder, site }
    }

    fn text(&self, file: &str) -> String {
        std::fs::read_to_string(self.folder.path().join(file)).unwrap()
    }

    fn put(&self, file: &str, text: &str) {
        std::fs::write(self.folder.path().join(file), text).unwrap();
    }

    fn says(&self, file: &str) -> Leaf {
        let files = self.site.files(file).unwrap();
        Credentials::read(&files).expect("certificate, key and authority go together");
        Leaf::read(&files.certificate).unwrap()
    }
}

fn surgeon() -> Leaf {
    Leaf {
        name: "Dr. Müller-Lüdenscheid".into(),
        role: Role::Surgeon,
        dns: Vec::new(),
        ip: Vec::new(),
        days: 30,
    }
}

#[test]
fn a_certificate_says_what_was_asked_for() {
    let world = World::new();
    for leaf in [surgeon(), Leaf::on_this_machine("motion")] {
        let file = leaf.file();
        world.site.issue(&leaf, &file).unwrap();
        assert_eq!(world.says(&file), leaf);
    }
    assert_eq!(surgeon().file(), "dr-müller-lüdenscheid");
}

#[test]
fn a_renewed_certificate_says_the_same_and_has_another_key() {
    let world = World::new();
    world.site.issue(&surgeon(), "s").unwrap();
    let (certificate, key) = (world.text("s.pem"), world.text("s.key"));
    world.site.reissue(&world.says("s"), "s").unwrap();
    assert_eq!(world.says("s"), surgeon());
    assert_ne!(world.text("s.pem"), certificate);
    assert_ne!(world.text("s.key"), key);
}

#[test]
fn both_authorities_are_trusted_until_the_old_one_is_retired() {
    let world = World::new();
    let old = world.text("ca.pem");
    world.site.rotate().unwrap();
    assert_eq!(world.site.trusted().unwrap(), 2);
    assert!(world.text("ca.pem").ends_with(&old));
    world.site.issue(&surgeon(), "s").unwrap();
    world.says("s");
    world.site.retire().unwrap();
    assert_eq!(world.site.trusted().unwrap(), 1);
    assert_ne!(world.text("ca.pem"), old);
    world.says("s");
}

#[test]
fn a_rotation_that_was_cut_off_before_its_key_issues_as_before() {
    let world = World::new();
    let (old, key) = (world.text("ca.pem"), world.text("ca.key"));
    world.site.rotate().unwrap();
    world.put("ca.key", &key);
    world.site.issue(&surgeon(), "s").unwrap();
    world.says("s");
    world.site.retire().unwrap();
    let pem = |text: &str| text.replace(['\r', '\n'], "");
    assert_eq!(pem(&world.text("ca.pem")), pem(&old));
}

#[test]
fn a_certificate_does_not_outlive_its_authority() {
    let folder = tempfile::tempdir().unwrap();
    let site = Site::init(folder.path(), "a short one", 20).unwrap();
    let refusal = site.issue(&surgeon(), "s").unwrap_err();
    assert_eq!(refusal.reason, "AUTHORITY_ENDS");
    assert!(!site.files("s").unwrap().certificate.exists());
}

#[test]
fn files_outside_the_folder_and_the_authority_itself_are_no_holders() {
    let world = World::new();
    for file in ["", "ca", "../elsewhere", ".hidden"] {
        assert_eq!(
            world.site.files(file).unwrap_err().reason,
            "FILE_NAME_INVALID"
        );
    }
}
