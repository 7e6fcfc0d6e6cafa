//! Pictures of the visible side can be switched off.

use super::client::Guarded;

#[test]
fn pictures_of_the_visible_side_are_withheld_where_they_are_switched_off() {
    let doorcam = Guarded::configured("[access]\nimages = false\n", &[]);
    for path in ["/api/v1/frame.jpg", "/api/v1/stream.mjpg", "/api/v1/patches.png", "/api/v1/calibration/reference.jpg"]
    {
        let refused = doorcam.ask("GET", path, &[]);
        assert_eq!(refused.status, 403, "{path}");
        assert!(refused.problem()["detail"].as_str().unwrap().contains("access.images"));
    }
    doorcam.daemon.wait_for("a map", |s| s["state"] == "watching");
    assert_eq!(doorcam.ask("GET", "/api/v1/reconstruction", &[]).status, 200);
    // Who walks through is no picture.
    let crossings = doorcam.ask("GET", "/api/v1/crossings", &[]);
    assert!(crossings.status == 200 && !crossings.body.contains("images"), "{}", crossings.body);
    assert!(doorcam.ask("GET", "/api/v1/session", &[]).body.contains("\"images\":false"));
    assert_eq!(doorcam.ask("GET", "/api/v1/difference.png", &[]).status, 200);
    // With pictures switched on, a recording of patches has no such picture, so the answer is 404 and not 403.
    assert_eq!(Guarded::start(&[]).ask("GET", "/api/v1/frame.jpg", &[]).status, 404);
}
