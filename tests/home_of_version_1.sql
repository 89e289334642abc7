PRAGMA user_version = 1;
BEGIN TRANSACTION;
CREATE TABLE change (
            id INTEGER PRIMARY KEY,
            verb TEXT NOT NULL,
            time TEXT NOT NULL,
            source TEXT,
            undoes INTEGER REFERENCES change,
            undone INTEGER REFERENCES change
        );
INSERT INTO "change" VALUES(1,'train','2026-11-01T12:00:00Z',NULL,NULL,NULL);
INSERT INTO "change" VALUES(2,'tell','2026-11-02T12:00:00Z','camera',NULL,NULL);
INSERT INTO "change" VALUES(3,'move','2026-11-03T12:00:00Z',NULL,NULL,NULL);
INSERT INTO "change" VALUES(4,'train','2026-11-04T12:00:00Z',NULL,NULL,NULL);
INSERT INTO "change" VALUES(5,'tell','2026-11-05T12:00:00Z','camera',NULL,NULL);
INSERT INTO "change" VALUES(6,'tell','2026-11-06T12:00:00Z',NULL,NULL,NULL);
INSERT INTO "change" VALUES(7,'tell','2026-11-07T12:00:00Z','camera',NULL,NULL);
INSERT INTO "change" VALUES(8,'tell','2026-11-08T12:00:00Z',NULL,NULL,NULL);
INSERT INTO "change" VALUES(9,'remove','2026-11-09T12:00:00Z',NULL,NULL,10);
INSERT INTO "change" VALUES(10,'undo','2026-11-09T13:00:00Z',NULL,9,NULL);
INSERT INTO "change" VALUES(11,'remove','2026-11-10T12:00:00Z',NULL,NULL,NULL);
INSERT INTO "change" VALUES(12,'tell','2026-11-11T12:00:00Z',NULL,NULL,13);
INSERT INTO "change" VALUES(13,'undo','2026-11-11T13:00:00Z',NULL,12,NULL);
INSERT INTO "change" VALUES(14,'tell','2026-11-12T12:00:00Z','a person',NULL,NULL);
INSERT INTO "change" VALUES(15,'remove','2026-11-13T12:00:00Z',NULL,NULL,NULL);
CREATE TABLE choice (  -- made on hidden known entities
            facts INTEGER NOT NULL,
            words INTEGER NOT NULL,
            requested TEXT NOT NULL,  -- an initializer and its options, or nothing
            initializer TEXT NOT NULL,
            options TEXT NOT NULL,
            why TEXT NOT NULL,
            trained_with TEXT NOT NULL,
            warnings TEXT NOT NULL,
            curves TEXT,  -- from scores to probabilities
            PRIMARY KEY (facts, words, requested)
        );
CREATE TABLE effect (  -- of a change on an entity, on a relation or on a fact
            change INTEGER NOT NULL REFERENCES change,
            effect TEXT NOT NULL,
            entity TEXT,
            head TEXT,
            relation TEXT,
            tail TEXT,
            before TEXT  -- JSON of the row; none: there was none
        );
INSERT INTO "effect" VALUES(2,'inserted','stove',NULL,NULL,NULL,NULL);
INSERT INTO "effect" VALUES(2,'added',NULL,'stove','atLocation','kitchen',NULL);
INSERT INTO "effect" VALUES(3,'retracted',NULL,'kettle','atLocation','kitchen','[1, "kettle", "atLocation", "kitchen", "trained", 1, null, null, null, null]');
INSERT INTO "effect" VALUES(3,'added',NULL,'kettle','atLocation','bedroom',NULL);
INSERT INTO "effect" VALUES(5,'inserted','mug',NULL,NULL,NULL,NULL);
INSERT INTO "effect" VALUES(5,'added',NULL,'mug','atLocation','kitchen',NULL);
INSERT INTO "effect" VALUES(5,'added',NULL,'mug','hasAffordance','lie on',NULL);
INSERT INTO "effect" VALUES(5,'seen',NULL,'bed','atLocation','bedroom','[1, "bed", "atLocation", "bedroom", "trained", 1, null, null, null, null]');
INSERT INTO "effect" VALUES(6,'seen',NULL,'mug','atLocation','kitchen','[6, "mug", "atLocation", "kitchen", "added", 1, null, "2026-11-05T12:00:00Z", "2026-11-05T12:00:00Z", "camera"]');
INSERT INTO "effect" VALUES(7,'believed',NULL,'mug','atLocation','kitchen','[6, "mug", "atLocation", "kitchen", "added", 2, null, "2026-11-05T12:00:00Z", "2026-11-06T12:00:00Z", "camera"]');
INSERT INTO "effect" VALUES(8,'new relation',NULL,NULL,'near',NULL,NULL);
INSERT INTO "effect" VALUES(8,'added',NULL,'stove','near','mug',NULL);
INSERT INTO "effect" VALUES(8,'added',NULL,'bed','near','mug',NULL);
INSERT INTO "effect" VALUES(9,'taken',NULL,'mug','atLocation','kitchen','[6, "mug", "atLocation", "kitchen", "added", 3, 0.8, "2026-11-05T12:00:00Z", "2026-11-07T12:00:00Z", "camera"]');
INSERT INTO "effect" VALUES(9,'taken',NULL,'mug','hasAffordance','lie on','[7, "mug", "hasAffordance", "lie on", "added", 1, 0.5, "2026-11-05T12:00:00Z", "2026-11-05T12:00:00Z", "camera"]');
INSERT INTO "effect" VALUES(9,'taken',NULL,'stove','near','mug','[8, "stove", "near", "mug", "added", 1, null, "2026-11-08T12:00:00Z", "2026-11-08T12:00:00Z", null]');
INSERT INTO "effect" VALUES(9,'taken',NULL,'bed','near','mug','[9, "bed", "near", "mug", "added", 1, null, "2026-11-08T12:00:00Z", "2026-11-08T12:00:00Z", null]');
INSERT INTO "effect" VALUES(9,'removed','mug',NULL,NULL,NULL,'[7, "mug", 0, null, "mug", "a cup", null, "{}", 0]');
INSERT INTO "effect" VALUES(11,'retracted',NULL,'bed','hasAffordance','lie on','[3, "bed", "hasAffordance", "lie on", "trained", 1, null, null, null, null]');
INSERT INTO "effect" VALUES(12,'inserted','tray',NULL,NULL,NULL,NULL);
INSERT INTO "effect" VALUES(12,'added',NULL,'tray','atLocation','kitchen',NULL);
INSERT INTO "effect" VALUES(14,'restored',NULL,'bed','hasAffordance','lie on','[3, "bed", "hasAffordance", "lie on", "retracted", 1, null, null, null, null]');
INSERT INTO "effect" VALUES(15,'taken',NULL,'mug','hasAffordance','lie on','[7, "mug", "hasAffordance", "lie on", "added", 1, 0.5, "2026-11-05T12:00:00Z", "2026-11-05T12:00:00Z", "camera"]');
INSERT INTO "effect" VALUES(15,'retracted',NULL,'kettle','hasAffordance','turn on','[2, "kettle", "hasAffordance", "turn on", "trained", 1, null, null, null, null]');
CREATE TABLE entity (
            id INTEGER PRIMARY KEY,  -- of a trained one: its row in the trained vectors
            name TEXT NOT NULL UNIQUE,
            trained INTEGER NOT NULL,
            kind TEXT,
            phrase TEXT NOT NULL,  -- the words of its name
            definition TEXT,
            initializer TEXT,  -- that was asked for; none: the one chosen
            options TEXT NOT NULL DEFAULT '{}',
            seed INTEGER NOT NULL DEFAULT 0
        );
INSERT INTO "entity" VALUES(0,'kitchen',1,'room','kitchen',NULL,NULL,'{}',0);
INSERT INTO "entity" VALUES(1,'bedroom',1,'room','bedroom',NULL,NULL,'{}',0);
INSERT INTO "entity" VALUES(2,'kettle',1,'object','kettle',NULL,NULL,'{}',0);
INSERT INTO "entity" VALUES(3,'bed',1,'object','bed',NULL,NULL,'{}',0);
INSERT INTO "entity" VALUES(4,'turn on',1,'affordance','turn on',NULL,NULL,'{}',0);
INSERT INTO "entity" VALUES(5,'lie on',1,'affordance','lie on',NULL,NULL,'{}',0);
INSERT INTO "entity" VALUES(6,'stove',1,'object','stove',NULL,NULL,'{}',0);
INSERT INTO "entity" VALUES(7,'mug',0,NULL,'mug','a cup',NULL,'{}',0);
CREATE TABLE fact (
            id INTEGER PRIMARY KEY,
            head TEXT NOT NULL,
            relation TEXT NOT NULL,
            tail TEXT NOT NULL,
            status TEXT NOT NULL CHECK (status IN ('trained', 'added', 'retracted')),
            count INTEGER NOT NULL DEFAULT 1,  -- how often it was observed
            confidence REAL,  -- from 0 to 1; none: it is believed
            first_seen TEXT,  -- UTC; none: not since training
            last_seen TEXT,
            source TEXT,  -- what reported it last
            UNIQUE (head, relation, tail)
        );
INSERT INTO "fact" VALUES(1,'bed','atLocation','bedroom','trained',2,NULL,'2026-11-05T12:00:00Z','2026-11-05T12:00:00Z','camera');
INSERT INTO "fact" VALUES(2,'kettle','hasAffordance','turn on','retracted',1,NULL,NULL,NULL,NULL);
INSERT INTO "fact" VALUES(3,'bed','hasAffordance','lie on','trained',2,NULL,'2026-11-12T12:00:00Z','2026-11-12T12:00:00Z','a person');
INSERT INTO "fact" VALUES(4,'stove','atLocation','kitchen','trained',1,0.7,'2026-11-02T12:00:00Z','2026-11-02T12:00:00Z','camera');
INSERT INTO "fact" VALUES(5,'kettle','atLocation','bedroom','trained',1,NULL,'2026-11-03T12:00:00Z','2026-11-03T12:00:00Z',NULL);
INSERT INTO "fact" VALUES(6,'mug','atLocation','kitchen','added',3,0.8,'2026-11-05T12:00:00Z','2026-11-07T12:00:00Z','camera');
INSERT INTO "fact" VALUES(8,'stove','near','mug','added',1,NULL,'2026-11-08T12:00:00Z','2026-11-08T12:00:00Z',NULL);
INSERT INTO "fact" VALUES(9,'bed','near','mug','added',1,NULL,'2026-11-08T12:00:00Z','2026-11-08T12:00:00Z',NULL);
CREATE TABLE relation (
            id INTEGER PRIMARY KEY,
            name TEXT NOT NULL UNIQUE,
            trained INTEGER NOT NULL,
            vector BLOB  -- of one that is not trained
        );
INSERT INTO "relation" VALUES(0,'atLocation',1,NULL);
INSERT INTO "relation" VALUES(1,'hasAffordance',1,NULL);
INSERT INTO "relation" VALUES(2,'near',0,X'D613DB3E6DBCB33E3ACDCC3E94E0BD3E');
CREATE TABLE setting (name TEXT PRIMARY KEY, value TEXT NOT NULL);
INSERT INTO "setting" VALUES('model_name','"distmult"');
INSERT INTO "setting" VALUES('model_options','{}');
INSERT INTO "setting" VALUES('words','{"source": "the vocabulary of isi", "text": "phrase", "model": null}');
INSERT INTO "setting" VALUES('trained_with','"logistic"');
INSERT INTO "setting" VALUES('made','{"by": "a test"}');
INSERT INTO "setting" VALUES('vectors','"vectors-bfa251bfc7488fab.safetensors"');
CREATE TABLE vector (  -- of an inserted entity
            entity TEXT PRIMARY KEY REFERENCES entity (name),
            change INTEGER NOT NULL,
            initializer TEXT NOT NULL,
            options TEXT NOT NULL,
            why TEXT NOT NULL,
            fallback TEXT,
            kind TEXT NOT NULL,
            notes TEXT NOT NULL,
            facts INTEGER NOT NULL,  -- number and words, for which the initializer was chosen
            words INTEGER NOT NULL,
            vector BLOB NOT NULL
        );
INSERT INTO "vector" VALUES('mug',15,'map','{"word_weight": 16.0, "relation_weight": 8.0, "strength": 0.5, "ratio": 3, "known_negatives": 0.3, "prior": "soft_hybrid"}','as named',NULL,'object','["mug counts as object, like the heads of atLocation"]',1,1,X'34CFD53E630F10BFB0058A3F9BA011BF');
CREATE INDEX fact_of_tail ON fact (tail);
CREATE INDEX fact_by_status ON fact (status);
CREATE INDEX change_that_trained ON change (verb) WHERE verb = 'train';
CREATE INDEX effect_of_change ON effect (change);
CREATE INDEX vector_by_change ON vector (change);
CREATE VIEW now AS
            SELECT head, relation, tail, status, count, confidence, first_seen, last_seen, source
            FROM fact WHERE status <> 'retracted';
CREATE VIEW history AS
            SELECT change.id, time, verb, source, effect, entity, head, relation, tail, undone,
                undoes
            FROM change LEFT JOIN effect ON effect.change = change.id
            ORDER BY change.id, effect.rowid;
CREATE TABLE file (name TEXT, content BLOB);
INSERT INTO file VALUES ('vectors-bfa251bfc7488fab.safetensors', X'c8000000000000007b22656e746974696573223a7b226474797065223a22463332222c227368617065223a5b372c345d2c22646174615f6f666673657473223a5b302c3131325d7d2c2272656c6174696f6e73223a7b226474797065223a22463332222c227368617065223a5b322c345d2c22646174615f6f666673657473223a5b3131322c3134345d7d2c22776f726473223a7b226474797065223a22463332222c227368617065223a5b372c39365d2c22646174615f6f666673657473223a5b3134342c323833325d7d7d2020200000803f000000000000000000000000000000000000803f0000000000000000000040400000803f00000040000000000000803f00000040000000000000004000000000000000000000803f000000000000000000000000000000000000803f423fc63e6fbcd9be07363e3f64fab6be0000803f0000803f000000000000000000000000000000000000803f0000803fa0ec3e3d1b9e9cbe78318fbcced2503e0b0f27bd78318f3c42201bbe9196fa3da0ecbe3b78310f3edd28953d7aa371be88f935beae42033e7106ad3dd5fd323efdb8e2bdd5fdb2bd133a89bdae42833d3cf5b8bd42201bbdae4203be71062dbea0ec3e3bfdb8623d98c1dc3dae42833d34ca563e0b0f273d34ca563d78318fbc78310f3cc6a76ebdae42033d9196fabd15ac6b3ea0ec3e3b0b0f273e6adb4abd9196fabda0ec3e3dc66ebdbe9196fabd42201b3da717a1bd34ca56bd42209b3d42201bbd0b0f27bd34ca56bd78318f3d6adbcabddd2815bef41b1e3e34cad63cedf03b3e34cad63d78318fbcfdb8623d34ca563d0b0fa7bd78310fbc98c1dc3d78310f3da0ec3ebcc6a7ee3cae4203bddd28953dae4203bdfdb862bd42209b3d0b0f273da0ec3ebdc6a76ebca0ec3e3cfdb862bda0ec3ebba0ec3ebbdd28953d0b0fa73da0ec3ebb78318f3ca0ecbebb9196fa3d78318f3ca0ecbe3bd5fd323dae4203bea0ec3ebd34cad63c0b0fa7bc34cad63c91967a3dc6a7ee3cc6a76ebd086682bd51018abe50403f3d7d95753e0c99c3bdaa3900bee82b25bd0c99433ee1764ebe6692043ec8f1473d0c99c3bd5edd2dbce82ba53d16815b3e6692843e1c36b23d0866823d707a9cbcfcfbd43d5040bfbd2cd3a03d40a350bd2069f3bd80170b3ee82ba5bdc8f147bd80170b3b40a3d0bd2069f33dc4be863d0c99c33d086682bdf8c893bd2e0662bda6b7eabdd88e363e80178bbc2069f33d981a7cbd80178b3bf8c8933df8c813bd74adddbdbe09303eec5ee63d5edd2d3c2e0662bdc8f1c7bd80170bbc251e4a3e40a3d0bba384a93d40a3d03c5edd2dbd22eb08be2e06623de82b253d80178bbde82b253d2069f33d707a9c3c2e06e23cec5e663e0866023e02b12b3ec4be86bd80178b3d9ecf523e707a9c3d981a7c3d5040bfbc086602bd086602bdf8c893bd5edd2d3dfcfbd4bd40a3d0bba6b76abd2cd3a03df8c813bd2e06e23cf8c8133d5edd2dbd40a350bc707a1cbdb65459bda384a93d3c708fbd5040bfbc2cd3a0bd80170b3b5040bf3d80170bbcaa39003ea6b7ea3d1566503d6137b53c613735bd6137b53dedb3fdbd1af9103cedb3fdbd9f12453e3e1823bdedb37d3c8356c73dafd86dbe1af9903df3463ebe52718cbec061033e29bf39bee38095bd3e18233da77559bca775d9bc252cf9bd613735bca775d9bd156650bd28d78f3eac089abda775593c88e9873da775d9bccf272cbd156650bdc8c4173eedb37dbc4ddecb3d030de73dfe3c133e1af9903d88e907bda77559bd1af910bccf27ac3d5ca474bd98af30be8356c73cb36b2e3e6137353ca77559bd88e9873d5ca474bd5ca4f43d0d033c3e88e987bd457b373ea775d93d5ca4f43dac089a3dbbcec2bd835647bda775d93bb28384be3985e23d8356c7bcdfedd43dedb37dbcc06103be88e907bd70fddd3d1af9903c74909ebdc8c4173e5ca4743dedb37dbc98af30be3985e2bdedb3fd3da775d9bc1af990bca775d93ddfedd43d1af990bc5ca474bd74909ebd8356c73d1af910bc398562bdcb94ebbcedb37d3c1af990bbcb946bbd52718c3dc06183bd1af9103cac081abd398562bd5ca4743d445fe3bd5cf3c6bd210c8a3d71e9803e905761bef62a12be1ec5babdaa32143ef62a12be59ac773e9c21533df2e3c2bdca499a3dee9cf33c445f633dc4bbfb3dc4bbfb3dbf7f283eda4fdfbdf62a123d73872abdf2e342bcf2e342bd445fe33cee9cf33cb4b5b6bdf62a92bc9f68223dfead34be445f633e445fe33d4ced01bc848d6fbe9f6822bdc4bb7bbdca499abdde96ae3dc6024b3dc602cbbdb7fc853d73872a3d01f5033e5cf3c6bd73872a3d5cf3c63d4ced013caa32143e88d4bebd35599ebd603a16be11fb483e4ced813cc4bb7b3d4ced81bcb7fc853df62a92bc4ced013c80511c3e35599ebd4ced813d445fe3bcca499a3dca491abd8c1b0e3e35591e3ec6024b3d80511cbeee9cf3bc7040db3db4b5b63d4ced01bb4ced01bc4ced01bbf2e342bcee9cf3bc210c0a3ef2e3c2bd1ec5ba3d1a7e6bbdee9cf33d1a7eebbd210c0a3eca491abdc4bb7bbd4ced01bc000000009f68223c9c2153bd4ced01bb4ced01bbde962ebef2e3c2bcde96ae3d9c21533d73872a3e88d4be3d2d9690be2082533ef95a0c3e3591673dd2424b3d287e82bdd5a8ea3d0f11ecbd50c418be0330313c8355edbdd3bafdbde8bfb83d0659893ca4928abc99f9a63d81a080bdc52001bdd99f09bcfad67fbe4fbae0bdb94948bea16e5fbe6bb2a63d38538bbdaaa4e0bada419abda47aa33d39bed73d14ab213dd30f5cbd3d900e3e5561bf3d4226673db67264bce10e8fbd575f24bcb58e3cbb29f77dbca00393bd60ac043e1d565bbdcb6102be5560b93d059aa73b43ce17bd70de90bdefac533e4050913b06aa623da299513ebe9b483ecea3e8bd87c622bef118133cc88edf3de00d893d752e1fbeb0ecfd3deb42ec3d27eeb8bddf0c033d14e7123d0e8a113c2d7087bd8d65ad3d2e5e023e9f020dbe998e6d3d17f1dd3daf4c003ea3540dbe2291fa3caef413ba64786c3d5cdfa93d3b76c33cf806b43d2ddf373dd156eabd19c819bc779ce33d08d3ba3c827afdbdad7bc13dffeb0fbde0a24f3dc0eadebd5560b9bdce88103d676026bdbe52933b291e07bd2833043e8680513daff002bcb46b94bec5cb6a3e1b74303e191202be5edadcbd960a84be738149beb03a873d74e3e7bcf28effbc21cef03cb9e203bd37a03c3dc505da3dd878143d207428be52ab033e20fdb8bd8b96d7bd19f70ebe4f5aaabd2d2a19bc3f8128bd2df1c93c816165bd21a9b2bd3bbf203d5534983d3172c83ddceaa2bdb99c31bdfb84c03dfd59e53df08ccabde5c7253eeaea023e6ee4db3d7d55febd4c0aa9bdfd0713bed3b4d4bc83eb513d0598293e8f932ebdd49f82bdf42a103e182e6ebd17373cbe296b423d39d5a6bb235688bd8b10583d11a2c43df718f4bd160874bbe3067b3dd8aa0dbdd16b61be7ffceebbe185dcbdca7834be44ae443e581d163cde9a193e31830c3e4f5799bc8ad83cbde62c75bdd49f023d15bf703c39d526bc97d88cbdc2744f3d1cac5bbd24280cbe5a8adbbcd34cf53d104052b91576ed3b48aec83ce9c8cd3b254dba3d144a42ba080b90bca23a273e80dd153ded912b3d6782c63ab633f63deac16c3db16974bdfa4ba9bce423223d4144ac3d2c2674bcb6c9c13c0dca1fbb1ccf90bdaec629be90bc473ecbd08bbc9fc1b83dd5452cbe0dca9f3dcbd00b3d4fc3333d5253043e1ccf10be0dca1f3d4fc3b33cf0bfbdbd90bc473eaec629bdc3b0eabdd1b55bbd0dca9fbc4fc333be525304be4fc3b33d798a9ebe1ccf903da351093ecbd00b3dc7403b3ebdcb9a3d6ccd953d0dca9fbbfdc4aebdb4ab793dcbd00bbd90bc47bd9b3168befb345e3ed1b5db3dd1b55bbd1ccf903d0dca1fbd90bc47bc90bc47bea35109be6ccd153d0dca9fbc9fc1b8bd0dca9fbbeb2f6d3e6ccd15bd13af6fbc73b2653d90bc47bc90bc473d73b2653dc7403b3e4fc3333d6ccd15bd0dca1fbe9fc1b83dd1b5dbbc81b7d63dcbd00b3dfdc42e3e90bc473c4fc3b33dfdc4aebd2ad401bef34f0e3e90bc47bc73b2e53d1ccf903daec6293dcbd00bbe0dca9f3b5dc8243e0dca1f3b7bd286bd7bd2863d13afef3d4fc3b3bc90bc47bd4fc3b33daec6293d2ad4813de0baccbd90bcc7bc0dca9fbb90bc47bd0dca9fbc0dca9f3d7bd286bd0dca9f3c13af6fbd4fc3333d90bc473d');
CREATE TABLE expected (content TEXT);
INSERT INTO expected VALUES ('{"history": [{"id": 2, "verb": "tell", "time": "2026-11-02T12:00:00+00:00", "source": "camera", "undone": false, "inserted": ["stove"], "removed": [], "relations": [], "added": [["stove", "atLocation", "kitchen"]], "seen": [], "unseen": [], "lost": [], "believed": [], "training": false}, {"id": 3, "verb": "move", "time": "2026-11-03T12:00:00+00:00", "source": null, "undone": false, "inserted": [], "removed": [], "relations": [], "added": [["kettle", "atLocation", "bedroom"]], "seen": [], "unseen": [], "lost": [["kettle", "atLocation", "kitchen"]], "believed": [], "training": true}, {"id": 4, "verb": "train", "time": "2026-11-04T12:00:00+00:00", "source": null, "undone": false, "inserted": [], "removed": [], "relations": [], "added": [], "seen": [], "unseen": [], "lost": [], "believed": [], "training": false}, {"id": 5, "verb": "tell", "time": "2026-11-05T12:00:00+00:00", "source": "camera", "undone": false, "inserted": ["mug"], "removed": [], "relations": [], "added": [["mug", "atLocation", "kitchen"], ["mug", "hasAffordance", "lie on"]], "seen": [["bed", "atLocation", "bedroom"]], "unseen": [], "lost": [], "believed": [], "training": false}, {"id": 6, "verb": "tell", "time": "2026-11-06T12:00:00+00:00", "source": null, "undone": false, "inserted": [], "removed": [], "relations": [], "added": [], "seen": [["mug", "atLocation", "kitchen"]], "unseen": [], "lost": [], "believed": [], "training": false}, {"id": 7, "verb": "tell", "time": "2026-11-07T12:00:00+00:00", "source": "camera", "undone": false, "inserted": [], "removed": [], "relations": [], "added": [], "seen": [["mug", "atLocation", "kitchen"]], "unseen": [], "lost": [], "believed": [["mug", "atLocation", "kitchen"]], "training": false}, {"id": 8, "verb": "tell", "time": "2026-11-08T12:00:00+00:00", "source": null, "undone": false, "inserted": [], "removed": [], "relations": ["near"], "added": [["stove", "near", "mug"], ["bed", "near", "mug"]], "seen": [], "unseen": [], "lost": [], "believed": [], "training": false}, {"id": 9, "verb": "remove", "time": "2026-11-09T12:00:00+00:00", "source": null, "undone": true, "inserted": [], "removed": ["mug"], "relations": [], "added": [], "seen": [], "unseen": [], "lost": [["mug", "atLocation", "kitchen"], ["mug", "hasAffordance", "lie on"], ["stove", "near", "mug"], ["bed", "near", "mug"]], "believed": [], "training": false}, {"id": 10, "verb": "undo", "time": "2026-11-09T13:00:00+00:00", "source": null, "undone": false, "inserted": ["mug"], "removed": [], "relations": [], "added": [["mug", "atLocation", "kitchen"], ["mug", "hasAffordance", "lie on"], ["stove", "near", "mug"], ["bed", "near", "mug"]], "seen": [], "unseen": [], "lost": [], "believed": [], "training": false}, {"id": 11, "verb": "remove", "time": "2026-11-10T12:00:00+00:00", "source": null, "undone": false, "inserted": [], "removed": [], "relations": [], "added": [], "seen": [], "unseen": [], "lost": [["bed", "hasAffordance", "lie on"]], "believed": [], "training": true}, {"id": 12, "verb": "tell", "time": "2026-11-11T12:00:00+00:00", "source": null, "undone": true, "inserted": ["tray"], "removed": [], "relations": [], "added": [["tray", "atLocation", "kitchen"]], "seen": [], "unseen": [], "lost": [], "believed": [], "training": false}, {"id": 13, "verb": "undo", "time": "2026-11-11T13:00:00+00:00", "source": null, "undone": false, "inserted": [], "removed": ["tray"], "relations": [], "added": [], "seen": [], "unseen": [], "lost": [["tray", "atLocation", "kitchen"]], "believed": [], "training": false}, {"id": 14, "verb": "tell", "time": "2026-11-12T12:00:00+00:00", "source": "a person", "undone": false, "inserted": [], "removed": [], "relations": [], "added": [["bed", "hasAffordance", "lie on"]], "seen": [], "unseen": [], "lost": [], "believed": [], "training": true}, {"id": 15, "verb": "remove", "time": "2026-11-13T12:00:00+00:00", "source": null, "undone": false, "inserted": [], "removed": [], "relations": [], "added": [], "seen": [], "unseen": [], "lost": [["mug", "hasAffordance", "lie on"], ["kettle", "hasAffordance", "turn on"]], "believed": [], "training": true}], "facts": [[1, "bed", "atLocation", "bedroom", "trained", 2, null, "2026-11-05T12:00:00Z", "2026-11-05T12:00:00Z", "camera"], [3, "bed", "hasAffordance", "lie on", "trained", 2, null, "2026-11-12T12:00:00Z", "2026-11-12T12:00:00Z", "a person"], [4, "stove", "atLocation", "kitchen", "trained", 1, 0.7, "2026-11-02T12:00:00Z", "2026-11-02T12:00:00Z", "camera"], [5, "kettle", "atLocation", "bedroom", "trained", 1, null, "2026-11-03T12:00:00Z", "2026-11-03T12:00:00Z", null], [6, "mug", "atLocation", "kitchen", "added", 3, 0.8, "2026-11-05T12:00:00Z", "2026-11-07T12:00:00Z", "camera"], [8, "stove", "near", "mug", "added", 1, null, "2026-11-08T12:00:00Z", "2026-11-08T12:00:00Z", null], [9, "bed", "near", "mug", "added", 1, null, "2026-11-08T12:00:00Z", "2026-11-08T12:00:00Z", null]], "vectors": {"mug": [0.4175964593887329, -0.5627347826957703, 1.078298568725586, -0.5688568949699402]}, "entities": [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [3.0, 1.0, 2.0, 0.0], [1.0, 2.0, 0.0, 2.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.38720136880874634, -0.42526575922966003, 0.7430118918418884, -0.35737907886505127]], "answers": [["kitchen", 0.4175964593887329, true], ["bedroom", -0.5627347826957703, false], ["mug", 0.549068033695221, true], ["kettle", 0.94215989112854, false], ["bed", -0.397969514131546, false]], "undone": [[[1, "bed", "atLocation", "bedroom", "trained", 2, null, "2026-11-05T12:00:00Z", "2026-11-05T12:00:00Z", "camera"], [2, "kettle", "hasAffordance", "turn on", "trained", 1, null, null, null, null], [3, "bed", "hasAffordance", "lie on", "trained", 2, null, "2026-11-12T12:00:00Z", "2026-11-12T12:00:00Z", "a person"], [4, "stove", "atLocation", "kitchen", "trained", 1, 0.7, "2026-11-02T12:00:00Z", "2026-11-02T12:00:00Z", "camera"], [5, "kettle", "atLocation", "bedroom", "trained", 1, null, "2026-11-03T12:00:00Z", "2026-11-03T12:00:00Z", null], [6, "mug", "atLocation", "kitchen", "added", 3, 0.8, "2026-11-05T12:00:00Z", "2026-11-07T12:00:00Z", "camera"], [7, "mug", "hasAffordance", "lie on", "added", 1, 0.5, "2026-11-05T12:00:00Z", "2026-11-05T12:00:00Z", "camera"], [8, "stove", "near", "mug", "added", 1, null, "2026-11-08T12:00:00Z", "2026-11-08T12:00:00Z", null], [9, "bed", "near", "mug", "added", 1, null, "2026-11-08T12:00:00Z", "2026-11-08T12:00:00Z", null]], [[1, "bed", "atLocation", "bedroom", "trained", 2, null, "2026-11-05T12:00:00Z", "2026-11-05T12:00:00Z", "camera"], [2, "kettle", "hasAffordance", "turn on", "trained", 1, null, null, null, null], [4, "stove", "atLocation", "kitchen", "trained", 1, 0.7, "2026-11-02T12:00:00Z", "2026-11-02T12:00:00Z", "camera"], [5, "kettle", "atLocation", "bedroom", "trained", 1, null, "2026-11-03T12:00:00Z", "2026-11-03T12:00:00Z", null], [6, "mug", "atLocation", "kitchen", "added", 3, 0.8, "2026-11-05T12:00:00Z", "2026-11-07T12:00:00Z", "camera"], [7, "mug", "hasAffordance", "lie on", "added", 1, 0.5, "2026-11-05T12:00:00Z", "2026-11-05T12:00:00Z", "camera"], [8, "stove", "near", "mug", "added", 1, null, "2026-11-08T12:00:00Z", "2026-11-08T12:00:00Z", null], [9, "bed", "near", "mug", "added", 1, null, "2026-11-08T12:00:00Z", "2026-11-08T12:00:00Z", null]], [[1, "bed", "atLocation", "bedroom", "trained", 2, null, "2026-11-05T12:00:00Z", "2026-11-05T12:00:00Z", "camera"], [2, "kettle", "hasAffordance", "turn on", "trained", 1, null, null, null, null], [3, "bed", "hasAffordance", "lie on", "trained", 1, null, null, null, null], [4, "stove", "atLocation", "kitchen", "trained", 1, 0.7, "2026-11-02T12:00:00Z", "2026-11-02T12:00:00Z", "camera"], [5, "kettle", "atLocation", "bedroom", "trained", 1, null, "2026-11-03T12:00:00Z", "2026-11-03T12:00:00Z", null], [6, "mug", "atLocation", "kitchen", "added", 3, 0.8, "2026-11-05T12:00:00Z", "2026-11-07T12:00:00Z", "camera"], [7, "mug", "hasAffordance", "lie on", "added", 1, 0.5, "2026-11-05T12:00:00Z", "2026-11-05T12:00:00Z", "camera"], [8, "stove", "near", "mug", "added", 1, null, "2026-11-08T12:00:00Z", "2026-11-08T12:00:00Z", null], [9, "bed", "near", "mug", "added", 1, null, "2026-11-08T12:00:00Z", "2026-11-08T12:00:00Z", null]], [[1, "bed", "atLocation", "bedroom", "trained", 2, null, "2026-11-05T12:00:00Z", "2026-11-05T12:00:00Z", "camera"], [2, "kettle", "hasAffordance", "turn on", "trained", 1, null, null, null, null], [3, "bed", "hasAffordance", "lie on", "trained", 1, null, null, null, null], [4, "stove", "atLocation", "kitchen", "trained", 1, 0.7, "2026-11-02T12:00:00Z", "2026-11-02T12:00:00Z", "camera"], [5, "kettle", "atLocation", "bedroom", "trained", 1, null, "2026-11-03T12:00:00Z", "2026-11-03T12:00:00Z", null], [6, "mug", "atLocation", "kitchen", "added", 3, 0.8, "2026-11-05T12:00:00Z", "2026-11-07T12:00:00Z", "camera"], [7, "mug", "hasAffordance", "lie on", "added", 1, 0.5, "2026-11-05T12:00:00Z", "2026-11-05T12:00:00Z", "camera"]], [[1, "bed", "atLocation", "bedroom", "trained", 2, null, "2026-11-05T12:00:00Z", "2026-11-05T12:00:00Z", "camera"], [2, "kettle", "hasAffordance", "turn on", "trained", 1, null, null, null, null], [3, "bed", "hasAffordance", "lie on", "trained", 1, null, null, null, null], [4, "stove", "atLocation", "kitchen", "trained", 1, 0.7, "2026-11-02T12:00:00Z", "2026-11-02T12:00:00Z", "camera"], [5, "kettle", "atLocation", "bedroom", "trained", 1, null, "2026-11-03T12:00:00Z", "2026-11-03T12:00:00Z", null], [6, "mug", "atLocation", "kitchen", "added", 2, null, "2026-11-05T12:00:00Z", "2026-11-06T12:00:00Z", "camera"], [7, "mug", "hasAffordance", "lie on", "added", 1, 0.5, "2026-11-05T12:00:00Z", "2026-11-05T12:00:00Z", "camera"]], [[1, "bed", "atLocation", "bedroom", "trained", 2, null, "2026-11-05T12:00:00Z", "2026-11-05T12:00:00Z", "camera"], [2, "kettle", "hasAffordance", "turn on", "trained", 1, null, null, null, null], [3, "bed", "hasAffordance", "lie on", "trained", 1, null, null, null, null], [4, "stove", "atLocation", "kitchen", "trained", 1, 0.7, "2026-11-02T12:00:00Z", "2026-11-02T12:00:00Z", "camera"], [5, "kettle", "atLocation", "bedroom", "trained", 1, null, "2026-11-03T12:00:00Z", "2026-11-03T12:00:00Z", null], [6, "mug", "atLocation", "kitchen", "added", 1, null, "2026-11-05T12:00:00Z", "2026-11-05T12:00:00Z", "camera"], [7, "mug", "hasAffordance", "lie on", "added", 1, 0.5, "2026-11-05T12:00:00Z", "2026-11-05T12:00:00Z", "camera"]], [[1, "bed", "atLocation", "bedroom", "trained", 1, null, null, null, null], [2, "kettle", "hasAffordance", "turn on", "trained", 1, null, null, null, null], [3, "bed", "hasAffordance", "lie on", "trained", 1, null, null, null, null], [4, "stove", "atLocation", "kitchen", "trained", 1, 0.7, "2026-11-02T12:00:00Z", "2026-11-02T12:00:00Z", "camera"], [5, "kettle", "atLocation", "bedroom", "trained", 1, null, "2026-11-03T12:00:00Z", "2026-11-03T12:00:00Z", null]]]}');
COMMIT;
