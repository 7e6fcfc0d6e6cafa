//! The page's files as the daemon sends them.

use std::io::Read;
use std::path::{Path, PathBuf};

use crate::common::{Daemon, grey_recording, manifest};

/// The page's files by the names the daemon serves them under, without the one that only the type checker reads.
fn files(directory: &Path, below: &Path, all: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files(&path, below, all);
        } else if !path.ends_with("types.js") {
            all.push(path.strip_prefix(below).unwrap().to_owned());
        }
    }
}

#[test]
fn all_of_it_weighs_less_than_200_kb_and_is_what_is_on_the_disk() {
    let source = grey_recording(&manifest(), 3);
    let daemon = Daemon::start(&format!("replay:{},loop", source.path().display()), &[]);
    let web = Path::new(env!("CARGO_MANIFEST_DIR")).join("web");
    let mut names = Vec::new();
    files(&web, &web, &mut names);
    assert!(names.len() > 20, "{names:?}");
    let agent = ureq::agent();
    let mut sent = 0;
    for name in &names {
        let url = format!("{}/{}", daemon.url, name.display());
        let mut response = agent.get(&url).header("accept-encoding", "gzip").call().unwrap();
        let gzipped = response.headers().get("content-encoding").is_some_and(|coding| coding == "gzip");
        let tag = response.headers().get("etag").unwrap().to_str().unwrap().to_owned();
        let mut body = Vec::new();
        response.body_mut().as_reader().read_to_end(&mut body).unwrap();
        sent += body.len();
        let mut whole = Vec::new();
        if gzipped {
            flate2::read::GzDecoder::new(&body[..]).read_to_end(&mut whole).unwrap();
        } else {
            whole = body;
        }
        assert_eq!(whole, std::fs::read(web.join(name)).unwrap(), "{url}");
        // A browser that has the file does not get it again.
        let known = agent.get(&url).header("if-none-match", &tag).call().unwrap();
        assert_eq!(known.status().as_u16(), 304, "{url}");
    }
    assert!(sent < 200_000, "{sent} bytes");
}
