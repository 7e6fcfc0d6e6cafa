use proptest::prelude::*;

use super::*;

fn sorted(names: &[&str], layout: Layout) -> Result<Listing, String> {
    let mut names: Vec<OsString> = names.iter().map(Into::into).collect();
    names.sort();
    sort(names, layout)
}

/// The frames as "number name", missing ones with a question mark; and the notes.
fn listing(names: &[&str], layout: Layout) -> (Vec<String>, Vec<String>) {
    let Listing { frames, notes } = sorted(names, layout).expect("a sequence");
    let words = |(number, files): (u64, Files)| match files {
        Files::Camera(file) => format!("{number} {}", file.display()),
        Files::Patches(left, right) => format!("{number} {} {}", left.display(), right.display()),
        Files::Missing(file) => format!("{number} {}?", file.display()),
    };
    (frames.into_iter().map(words).collect(), notes)
}

fn camera(names: &[&str]) -> (Vec<String>, Vec<String>) {
    listing(names, Layout::Camera)
}

const NO_NOTES: [&str; 0] = [];

#[test]
fn numbers_count_and_not_the_order_of_the_names() {
    let names: Vec<String> = (0..150).map(|n| format!("frame{n}.jpg")).collect();
    let (frames, notes) = camera(&names.iter().map(String::as_str).collect::<Vec<_>>());
    let expected: Vec<String> = (0..150).map(|n| format!("{n} frame{n}.jpg")).collect();
    assert_eq!((frames, notes), (expected, vec![]));

    let (frames, notes) = camera(&["img_9.png", "img_10.PNG", "img_11.jpeg"]);
    assert_eq!(frames, ["9 img_9.png", "10 img_10.PNG", "11 img_11.jpeg"]);
    assert_eq!(notes, NO_NOTES);
    // The last number is the frame's.
    let (frames, _) = camera(&["cam2_7.jpg", "cam2_8.jpg"]);
    assert_eq!(frames, ["7 cam2_7.jpg", "8 cam2_8.jpg"]);
    let (frames, _) = camera(&["shot 7 rgb.jpg", "shot 8 rgb.jpg"]);
    assert_eq!(frames, ["7 shot 7 rgb.jpg", "8 shot 8 rgb.jpg"]);
}

#[test]
fn strays_move_no_frame_and_are_named() {
    let strays = [
        "._00000001.jpg",
        "00000000 (copy).jpg",
        "00000001 (1).jpg",
        "Thumbs.db",
        ".DS_Store",
        "cover.jpg",
        "old9.jpg",
    ];
    let frames = ["00000000.jpg", "00000001.jpg", "00000002.jpg"];
    let (found, notes) = camera(&[&strays[..], &frames].concat());
    assert_eq!(found, ["0 00000000.jpg", "1 00000001.jpg", "2 00000002.jpg"]);
    assert_eq!(
        notes,
        [
            "7 files are left out, as no frames: .DS_Store, ._00000001.jpg, 00000000 (copy).jpg, 00000001 (1).jpg, Thumbs.db and 2 more"
        ]
    );
    let (_, notes) = camera(&["0.jpg", "1.jpg", "a\nb.txt"]);
    assert_eq!(notes, ["1 file is left out, as no frames: a\\nb.txt"]);
}

#[test]
fn copies_of_all_frames_are_strays_too() {
    let (found, _) = camera(&["0.jpg", "0 (copy).jpg", "1.jpg", "1 (copy).jpg"]);
    assert_eq!(found, ["0 0.jpg", "1 1.jpg"]);
}

#[test]
fn what_the_frames_are_is_not_guessed() {
    let error = sorted(&["a_0.jpg", "a_1.jpg", "b_0.jpg", "b_1.jpg"], Layout::Camera).expect_err("two sequences");
    assert_eq!(
        error,
        "it is unclear which of the 4 images are the frames (a_0.jpg or b_0.jpg), expected one numbered sequence"
    );
    sorted(&["alpha.jpg", "beta.jpg", "gamma2.jpg"], Layout::Camera).expect_err("one number only");
    sorted(&[], Layout::Camera).expect_err("none");
    sorted(&["Thumbs.db", "._1.jpg"], Layout::Camera).expect_err("only strays");
    sorted(&["left.png", "right.png"], Layout::Patches).expect_err("no numbers");
}

#[test]
fn only_names_without_any_number_go_by_their_order() {
    let (frames, notes) = camera(&["b.jpg", "a.jpg", "notes.txt"]);
    assert_eq!(frames, ["0 a.jpg", "1 b.jpg"]);
    assert_eq!(
        notes,
        [
            "no name has a number: the frames are taken in the order of their names",
            "1 file is left out, as no frames: notes.txt"
        ]
    );
}

#[test]
fn of_two_files_for_one_frame_the_likelier_is_taken_and_the_other_named() {
    let (frames, notes) = camera(&["00.jpg", "01.jpg", "02.jpg", "1.jpg", "01.png"]);
    assert_eq!(frames, ["0 00.jpg", "1 01.jpg", "2 02.jpg"]);
    assert_eq!(notes, ["2 files are left out, as their numbers are there twice: 01.png, 1.jpg"]);
    let (frames, _) = camera(&["4.jpg", "5.jpg", "05.jpg", "10.jpg"]);
    assert_eq!(frames[1], "5 5.jpg");
}

#[test]
fn what_is_missing_is_called_as_its_neighbours_are() {
    let (frames, notes) = camera(&["frame8.jpg", "frame11.jpg"]);
    assert_eq!(frames, ["8 frame8.jpg", "9 frame9.jpg?", "10 frame10.jpg?", "11 frame11.jpg"]);
    assert_eq!(notes, ["2 frames are missing, by the numbers: 9 to 10"]);
    let (frames, notes) = camera(&["00000001.png", "00000003.png"]);
    assert_eq!((&frames[1][..], &notes[0][..]), ("2 00000002.png?", "1 frame is missing, by the numbers: 2"));
    let (frames, _) = listing(&["0000_left.jpg", "0000_right.jpg", "0001_left.jpg", "0003_right.png"], Layout::Patches);
    assert_eq!(frames, ["0 0000_left.jpg 0000_right.jpg", "1 0001_right.jpg?", "2 0002_left.jpg?", "3 0003_left.png?"]);
}

#[test]
fn patches_follow_the_same_rules() {
    let names = [
        "p9_left.png",
        "p9_right.png",
        "p10_left.png",
        "p10_right.png",
        "._p9_left.png",
        "p9_left (copy).png",
        "10_left.png",
        "p10_middle.png",
    ];
    let (frames, notes) = listing(&names, Layout::Patches);
    assert_eq!(frames, ["9 p9_left.png p9_right.png", "10 p10_left.png p10_right.png"]);
    assert!(notes[0].starts_with("4 files are left out, as no frames: ._p9_left.png, 10_left.png, "), "{notes:?}");
}

#[test]
fn gaps_of_another_way_of_numbering_are_not_filled() {
    let (frames, notes) = camera(&["0.jpg", "1.jpg", "5000.jpg"]);
    assert_eq!((frames.len(), &notes[0][..]), (3, "the numbers jump, which counts as no loss: 1 to 5000"));
    let names: Vec<String> = (0..3000).map(|n| format!("{}.jpg", 900 * n)).collect();
    let (frames, notes) = camera(&names.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(frames.len(), 3000);
    assert!(notes[0].ends_with("and 2994 more"), "{notes:?}");
    let huge = format!("{}.jpg", u64::MAX);
    assert_eq!(camera(&["0.jpg", &huge]).0.len(), 2);
    // Longer than any number: it is none.
    assert_eq!(camera(&["0.jpg", &format!("{}0.jpg", u64::MAX)]).0.len(), 1);
}

proptest! {
    #[test]
    fn any_names_are_listed_once_each_or_refused(
        names in proptest::collection::vec("[._ a-b(0-9é]{0,5}(_left|_right|)[.](jpg|png|JPG|db)", 0..12), patches in any::<bool>(),
    ) {
        let layout = if patches { Layout::Patches } else { Layout::Camera };
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        if let Ok(Listing { frames, .. }) = sorted(&names, layout) {
            prop_assert!(frames.windows(2).all(|w| w[0].0 < w[1].0), "{:?}", frames);
            prop_assert!(frames.len() <= 1 + 1001 * names.len());
        }
    }
}
